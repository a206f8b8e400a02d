"""Functions whose results tests and the programs that they start keep: by module, with the folders they depend on."""

KEPT = {
    "gcs.plan.verification.verify": ("verify",),
    "gcs.plan.planner": ("make_plan",),
    "gcs.mission.waypoints.arrival_times": ("corrected_legs", "gcs/mission"),
    "gcs.mission.returns.rtl_altitudes": ("plan_returns", "gcs/mission"),
}
