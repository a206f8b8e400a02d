"""The optimal control problem of the leader, with every follower's constraints folded in (Eqs. 15-35, 51)."""
