"""One vehicle's decisions: modes, arming, failsafes, mission progress."""
