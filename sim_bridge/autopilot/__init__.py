"""The decisions of one vehicle: flight modes, arming, failsafes, landing detection and mission progress."""
