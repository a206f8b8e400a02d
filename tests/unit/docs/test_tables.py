"""Tables of promises in the documents: every row has a test, and every test named for one exists."""

from __future__ import annotations

import ast
import functools
from pathlib import Path

import pytest

from gcs.flight.contingency.policy_rows import KEEPS, POLICY

MISHAPS = "tests/bridge/test_mishaps.py"
OFF_SETPOINTS = "tests/bridge/test_off_setpoints.py"
HOLDS_AND_LANDS = "test_a_slow_vehicle_holds_one_that_is_dragged_away_lands_and_the_third_flies_on"
NEAR = "tests/bridge/test_giving_way.py"
DELIVERY = "tests/unit/link/protocols/mission/test_verified_upload.py"
STORED = "tests/unit/link/protocols/mission/test_stored_items.py"
MACHINES = "tests/unit/link/test_mission_machines.py"
PARAMETERS = "tests/unit/link/test_parameters.py"
STATUS = "tests/unit/link/session/test_status_report.py"
PREFLIGHT = "tests/unit/flight/setup/test_preflight_rules.py"
PROLOGUE = "tests/unit/flight/execution/test_takeoff_landing.py"
STREAM = "tests/unit/flight/execution/test_setpoint_schedule.py"

RULES = "tests/unit/flight/contingency/test_policy.py"
ENERGY = "tests/unit/flight/contingency/test_energy_choice.py"
FAILSAFES = "tests/unit/flight/contingency/test_recorded_failsafe.py"
REJOIN = "tests/unit/flight/contingency/test_common_rejoin.py"
START = "tests/bridge/test_start.py"
HOSTILE = "tests/hostile/test_"
RECORDS = "tests/unit/flight/recording/test_flight_record.py"
STALLS = "tests/hostile/test_stalls.py"
ASKED = "tests/unit/flight/execution/test_executor.py"
HOLDING = (NEAR, "test_a_vehicle_with_time_to_brake_holds_and_returns")
CLIMBING = (NEAR, "test_a_vehicle_without_time_to_brake_climbs")
NEAR_MISS = "tests/unit/flight/execution/test_near_miss.py"

# Each rule of the contingency policy, and the flight or test that proves it.
POLICY_PROOFS = {
    "A vehicle without motors falls: no order can help it": [
        (
            "tests/unit/flight/execution/test_executor.py",
            "test_a_vehicle_that_is_disarmed_in_the_air_is_lost_and_the_others_land",
        )
    ],
    "It is told; the vehicle keeps its order, and its autopilot its failsafes": [
        ("tests/unit/flight/contingency/test_alarm_watch.py", "test_the_others_follow_on_loss_when_one_falls")
    ],
    "It is told, so that the operator tells the service supplier; the vehicle keeps its order": [
        (
            "tests/bridge/test_volumes.py",
            "test_the_one_that_is_pushed_out_of_its_volume_is_told_and_the_others_are_not",
        )
    ],
    "A vehicle off its setpoints brakes and holds": [(OFF_SETPOINTS, HOLDS_AND_LANDS)],
    "A vehicle that does not follow setpoints lands by its autopilot": [(OFF_SETPOINTS, HOLDS_AND_LANDS)],
    "A vehicle is off its predicted track: all vehicles brake and hold": [
        (NEAR_MISS, "test_without_the_conflict_the_late_vehicle_is_seen_off_its_track")
    ],
    "Vehicles that fly missions on board all brake and hold": [
        (NEAR_MISS, "test_all_hold_a_minute_and_a_half_before_it_and_come_home_apart")
    ],
    "The setpoint stream continues": [(MISHAPS, "test_a_link_that_comes_back_soon")],
    "A vehicle heard again in its place rejoins; its deviation fades in 8 s": [
        (MISHAPS, "test_a_link_that_comes_back_soon")
    ],
    "A vehicle heard again too late, off its place or in another mode returns": [
        (MISHAPS, "test_a_link_that_comes_back_late")
    ],
    "A lost vehicle gets no order until it is heard again": [(MISHAPS, "test_a_vehicle_is_lost_the_others_land")],
    "The vehicle flies on by its own estimate": [(MISHAPS, "test_a_short_outage_of_gnss")],
    "The vehicle flies on": [(MISHAPS, "test_a_short_outage_of_gnss")],
    "A vehicle without a position lands at once": [(MISHAPS, "test_a_long_outage_of_gnss")],
    "Before T0 a vehicle in trouble lands on its pad": [(RULES, "test_trouble_before_t0_lands_all_on_their_pads")],
    "A vehicle was in trouble before T0: all others land on their pads": [
        (RULES, "test_trouble_before_t0_lands_all_on_their_pads")
    ],
    "A vehicle with a low battery finishes the plan if the reserve is left then": [
        (MISHAPS, "test_a_low_battery_that_lasts_for_the_plan_changes_nothing"),
        (ENERGY, "test_recorded_vehicles_over_their_landing_points_land_there"),
    ],
    "A vehicle with a low battery lands at the nearest safe point": [(RULES, "test_one_leaves_the_others_fly_on")],
    "A vehicle with a low battery returns": [(RULES, "test_one_leaves_the_others_fly_on")],
    "A vehicle whose battery allows nothing else lands where it is": [
        (MISHAPS, "test_a_low_battery_that_lasts_for_nothing_else_lands")
    ],
    "With a critical battery a vehicle ends what it began, if the energy for it is left": [
        (RULES, "test_a_critical_battery_ends_a_return_that_it_does_not_last_for")
    ],
    "A vehicle with a critical battery lands at the nearest safe point": [(RULES, "test_one_leaves_the_others_fly_on")],
    "A vehicle with a critical battery returns if its pad is the nearest safe point": [
        (RULES, "test_every_row_is_reached_and_done")
    ],
    "A vehicle with a critical battery lands at once": [(MISHAPS, "test_a_critical_battery_lands_at_once")],
    "A vehicle outside the fence returns": [(NEAR, "test_a_vehicle_blown_over_the_fence_returns")],
    "A vehicle that left its mode for a pause of this program follows setpoints again": [
        (STALLS, "test_stopped_in_flight_it_leads_all_back_to_the_plan"),
        (RULES, "test_a_failsafe_that_this_program_caused_by_its_standstill_ends_no_flight"),
    ],
    "A vehicle that came down is ordered to land, which stops its motors": [
        ("tests/bridge/test_crash.py", "test_a_vehicle_that_came_down_stops_its_motors_and_the_others_fly_on")
    ],
    "After a pause of this program all vehicles are led back to the plan together": [
        (STALLS, "test_stopped_in_flight_it_leads_all_back_to_the_plan")
    ],
    "Without a safe way back to the plan after a pause of this program, vehicles return": [
        (RULES, "test_stranded_vehicles_are_led_back_or_return"),
        (REJOIN, "test_vehicles_far_from_the_plan_have_no_way_back"),
    ],
    "A vehicle in its failsafe's mode is taken over again and returns": [
        (FAILSAFES, "test_none_of_six_in_their_failsafes_hold_is_left_alone"),
        (NEAR, "test_a_vehicle_blown_over_the_fence_returns"),
    ],
    "A vehicle in its failsafe's mode is taken over again and lands at the nearest safe point": [
        (RULES, "test_every_row_is_reached_and_done")
    ],
    "A vehicle that cannot be taken over safely from its failsafe lands": [
        (RULES, "test_a_vehicle_is_taken_over_from_its_failsafe_twice_and_then_lands"),
        (RULES, "test_a_failsafe_without_a_position_lands"),
    ],
    "A vehicle in a mode that was not ordered, and no failsafe's, is left to its pilot": [HOLDING, CLIMBING],
    "A vehicle that disobeys an order to stop or to return is ordered to land": [
        (RULES, "test_a_return_that_is_not_obeyed_becomes_a_landing")
    ],
    "The yielding vehicle brakes and holds": [HOLDING],
    "The upper vehicle climbs by 2 m": [CLIMBING],
    "The yielding vehicle lands": [CLIMBING, (RULES, "test_conflicts_escalate_hold_spread_land")],
    "An earlier order gets time to act, or no vehicle can yield": [(RULES, "test_conflicts_escalate_hold_spread_land")],
    "A vehicle that yielded returns after 5 s without a conflict": [HOLDING],
    "A vehicle was lost: all others land": [(MISHAPS, "test_a_vehicle_is_lost_the_others_land")],
    "A vehicle was lost: all others return": [(MISHAPS, "test_a_vehicle_is_lost_the_others_return_staggered")],
    "All others continue": [(MISHAPS, "test_a_vehicle_is_lost_the_others_go_on")],
    "The others are planned anew, around where the lost vehicle may be": [
        ("tests/bridge/test_plan_orders.py", "test_ranks_close_when_a_vehicle_dies")
    ],
    "A vehicle was lost, and no plan without it was verified in time: all others land": [
        ("tests/bridge/test_plan_orders.py", "test_the_others_land_if_the_ranks_cannot_close")
    ],
    "The next vehicle leads": [(MISHAPS, "test_a_leader_is_lost_and_another_leads")],
    "The formation has no leader: all vehicles return": [(RULES, "test_without_a_leader_all_may_return")],
    "The operator ordered it to hold": [(ASKED, "test_one_vehicle_holds_until_the_operator_brings_it_home")],
    "The operator ordered it to land": [(RULES, "test_each_state_has_the_answer_to_what_befalls_others")],
    "The operator ordered it to return": [
        ("tests/bridge/test_attach.py", "test_it_returns"),
        (ASKED, "test_all_return_when_the_operator_orders_it"),
    ],
    "The operator ordered to continue: the waiting vehicles are led back to the plan together": [
        (ASKED, "test_the_plan_waits_while_all_hold_and_goes_on_when_they_continue")
    ],
}

# Each row of docs/flying.md on the ground station itself.
FLOWN = {
    "all vehicles silent": [(NEAR, "test_all_fall_silent_and_land")],
    "ground station stopped (Ctrl-C, SIGTERM, or SIGHUP because its terminal was closed; at any step, once or often)": [
        ("tests/bridge/test_stopped.py", "test_a_flight_may_be_stopped_at_any_time"),
        ("tests/bridge/test_fly.py", "test_ctrl_c_lands_vehicles_that_are_not_ours"),
        (HOSTILE + "signals.py", "test_a_signal_lands_what_is_in_the_air"),
        (HOSTILE + "signals.py", "test_under_nohup_the_flight_outlives_its_terminal"),
        (HOSTILE + "signals.py", "test_an_upload_is_rolled_back"),
    ],
    "output fails (terminal closed, reader of a pipe gone, disk full, character not in the encoding)": [
        (HOSTILE + "outputs.py", "test_a_terminal_that_is_closed_in_flight"),
        (HOSTILE + "outputs.py", "test_a_reader_that_leaves_in_flight"),
    ],
    "the terminal blocks (Ctrl-S, a stalled connection)": [
        (HOSTILE + "outputs.py", "test_a_terminal_that_stands_still_does_not_stop_the_stream")
    ],
    "the disk is full, or fails": [(HOSTILE + "disks.py", "test_a_disk_that_is_full_in_flight_and_has_room_again")],
    "the disk blocks": [(RECORDS, "test_a_disk_that_stands_still_keeps_no_frame_waiting")],
    "the flight's folder is deleted": [(HOSTILE + "disks.py", "test_a_flight_whose_folder_is_deleted")],
    "no room for the record, before the flight": [
        (HOSTILE + "disks.py", "test_without_room_nothing_is_uploaded"),
        (HOSTILE + "disks.py", "test_a_folder_that_cannot_be_written_is_a_refusal"),
    ],
    "flight refused, not confirmed, or stopped before it arms": [
        (HOSTILE + "custody.py", "test_further_flights_of_vehicles_that_fly_leave_them_alone"),
        (HOSTILE + "custody.py", "test_a_flight_that_is_not_confirmed_reads_what_is_on_board_and_changes_nothing"),
    ],
    "vehicle armed by a pilot or another ground station": [
        (HOSTILE + "custody.py", "test_a_vehicle_that_a_pilot_flies_is_left_to_the_pilot")
    ],
    "one vehicle refuses to be armed, or does not answer": [
        (START, "test_one_refuses_to_be_armed_and_the_others_stand_still_within_two_seconds"),
    ],
    "a vehicle fails at its take-off": [
        (START, "test_a_motor_that_is_dead_at_the_take_off"),
        ("tests/unit/flight/contingency/test_climb_watch.py", "test_no_recorded_take_off_fails"),
    ],
    "a vehicle rebooted": [
        (START, "test_a_reboot_after_the_checks_ends_the_flight_before_arming"),
        (START, "test_a_reboot_in_flight_is_a_loss_and_is_told"),
    ],
    "HEARTBEATs, but no position and no time": [
        (START, "test_a_vehicle_that_never_reports_again_ends_the_wait_for_its_clock"),
        (START, "test_a_reboot_of_the_only_vehicle_whose_clock_the_flight_has"),
    ],
    "any exception in flight": [
        (HOSTILE + "every_await.py", "test_whatever_fails_while_vehicles_fly_they_land"),
        (HOSTILE + "every_await.py", "test_whatever_fails_anywhere_all_vehicles_land"),
    ],
    "an exception in the landing": [(HOSTILE + "every_await.py", "test_a_landing_that_fails_itself_is_begun_again")],
    "an exception in a log, screen or hook": [
        (HOSTILE + "every_await.py", "test_reports_that_fail_do_not_reach_the_flight")
    ],
    "vehicles came down before the plan's landing, without any incident": [
        (HOSTILE + "ended_early.py", "test_a_vehicle_that_is_disarmed_in_the_air_by_another_station"),
        (HOSTILE + "ended_early.py", "test_a_common_time_that_is_wrong_does_not_end_a_flight_as_if_it_were_flown"),
    ],
    "a plan file was changed, its checksum and stored verdict made anew": [
        (
            HOSTILE + "files_bombs.py",
            "test_a_plan_with_changed_tracks_and_a_new_checksum_reaches_no_file_and_no_vehicle",
        ),
        (HOSTILE + "files_bombs.py", "test_attach_resumes_no_changed_plan_and_still_brings_its_vehicles_down"),
    ],
    "an untrusted file: huge, packed zeros, damaged, a pipe or a device": [
        (HOSTILE + "files_bombs.py", "test_two_megabytes_of_packed_zeros_are_no_plan"),
        (HOSTILE + "files_bombs.py", "test_mutated_files_never_reach_a_bug"),
    ],
    "an argument that is no number, no path or no fault (`--fault 99:die`, `--speedup inf`)": [
        (HOSTILE + "arguments.py", "test_no_argument_reaches_a_bug"),
        (HOSTILE + "arguments.py", "test_what_is_wrong_is_said_in_a_sentence"),
    ],
    "bytes that are no frames, up to any rate": [
        (HOSTILE + "floods.py", "test_bytes_that_are_no_frames_hold_nothing_up")
    ],
    "systems that are not in the plan": [
        (HOSTILE + "floods.py", "test_the_heartbeats_of_all_other_systems_are_counted_and_told_once")
    ],
    "another address claims a vehicle": [
        (HOSTILE + "spoofing.py", "test_a_vehicle_keeps_its_address_while_the_ground_station_stands_still"),
        (HOSTILE + "lies.py", "test_lies_from_another_port_change_nothing"),
    ],
    "a vehicle is at a new address": [
        (HOSTILE + "spoofing.py", "test_a_vehicle_that_restarts_at_another_port_proves_who_it_is"),
        ("tests/unit/link/session/test_routing_table.py", "test_in_a_flight_a_vehicle_that_reports_no_id_never_moves"),
    ],
    "two claims of one system id before the flight": [
        (HOSTILE + "spoofing.py", "test_who_claims_a_vehicle_before_it_is_heard_stops_the_flight_and_gets_nothing")
    ],
    "no route, interface down, a firewall on this machine": [
        ("tests/bridge/test_endpoint_udp.py", "test_what_the_operating_system_refuses_is_a_lost_frame")
    ],
    "ground station paused (stopped, suspended, swapped out, busy) for more than 1 s": [
        (STALLS, "test_stopped_in_flight_it_leads_all_back_to_the_plan"),
        (STALLS, "test_stopped_on_the_ground_or_in_a_landing_it_goes_on"),
        (STALLS, "test_emulated_vehicles_that_wait_meanwhile_notice_nothing"),
        ("tests/unit/util/test_steady_loop.py", "test_a_stopped_program_reads_its_answers_before_its_timeouts"),
    ],
    "ground station killed": [
        ("tests/bridge/test_attach.py", "test_it_is_found_shown_and_flown_to_its_end"),
        ("tests/bridge/test_attach.py", "test_it_lands"),
        (HOSTILE + "attach_after.py", "test_it_lands_after_a_kill_in_every_phase"),
    ],
    "`gcs attach`, and a vehicle is not heard": [
        (HOSTILE + "attach_after.py", "test_a_vehicle_that_is_not_heard_does_not_keep_the_others_up")
    ],
    "`gcs attach` twice, or while `gcs fly` runs": [
        (HOSTILE + "attach_after.py", "test_two_ground_stations_do_not_fly_one_flight"),
        (HOSTILE + "attach_after.py", "test_a_second_attach_is_refused"),
    ],
    "`flight.json` is damaged, missing, or of another version": [
        (HOSTILE + "attach_after.py", "test_a_flight_without_its_state_lands_by_its_links")
    ],
    "the network interface goes down and comes up": [
        (HOSTILE + "interface_down.py", "test_an_interface_that_goes_down_and_up")
    ],
    "frames are damaged, cut, doubled, late": [(HOSTILE + "mutated_frames.py", "test_damaged_frames_change_nothing")],
    "a vehicle reports false values with a valid checksum": [
        (HOSTILE + "mutated_frames.py", "test_whatever_vehicles_say_the_flight_ends_by_a_rule")
    ],
    "a vehicle answers MAVLink FTP without giving new bytes": [
        (
            "tests/property/link/test_forged_answers.py",
            "test_forged_answers_end_in_time_and_nothing_unequal_is_accepted",
        )
    ],
    "one vehicle's GNSS time jumps in flight": [
        (HOSTILE + "clocks.py", "test_jumps_of_gnss_time_are_told_and_not_followed")
    ],
    "all vehicles' GNSS times jump (a leap second, a false constellation)": [
        (HOSTILE + "clocks.py", "test_a_strangers_time_the_hosts_clock_and_a_jump_of_all_vehicles_change_nothing")
    ],
    "a GNSS time more than 1 s from the other vehicles' before arming": [
        (HOSTILE + "clocks.py", "test_a_vehicle_with_another_time_is_named_before_anything_is_armed")
    ],
    "a jump between take-off and the common start of missions on board": [
        ("tests/bridge/test_clock_jumps.py", "test_a_jump_before_the_common_start_lands_all_and_names_the_vehicle")
    ],
    "a time from an unknown system, or an impossible one (before 2010, after 2099)": [
        (HOSTILE + "clocks.py", "test_a_strangers_time_the_hosts_clock_and_a_jump_of_all_vehicles_change_nothing")
    ],
    "the computer's clock is set in flight": [
        ("tests/unit/test_wall_clock.py", "test_no_flight_reads_the_wall_clock"),
        (HOSTILE + "clocks.py", "test_a_strangers_time_the_hosts_clock_and_a_jump_of_all_vehicles_change_nothing"),
    ],
}

# Each row of docs/autopilots.md, and the tests of what Skein does about it.
HABITS = {
    "silence until asked": [(PROLOGUE, "test_nothing_is_expected_that_was_not_asked_for")],
    "readiness too early": [("tests/unit/autopilots/test_traits.py", "test_ready_as_the_recordings_show_it")],
    "denied requests": [(STATUS, "test_what_is_not_streamed_and_denied_is_streamed_for_a_moment")],
    "no remote control": [(PREFLIGHT, "test_the_scenario_says_which_sensors_are_required")],
    "home moves": [
        ("tests/unit/autopilots/test_traits.py", "test_altitudes_of_take_off"),
        (STREAM, "test_a_message_says_the_plan_in_the_vehicles_own_frame_and_clock"),
    ],
    "metres of a local frame": [
        ("tests/unit/autopilots/test_local_frame.py", "test_a_local_position_is_where_the_receiver_says"),
        (STREAM, "test_a_message_says_the_plan_in_the_vehicles_own_frame_and_clock"),
        ("tests/unit/flight/monitoring/test_monitor.py", "test_a_report_counts_metres_as_its_autopilot_does"),
    ],
    "uid 0": [("tests/unit/link/session/test_routing_table.py", "test_an_empty_uid2_leaves_it_to_the_uid")],
    "unknown parameter": [(PARAMETERS, "test_unknown_names_are_answered_by_silence_and_named")],
    "renamed parameters": [
        ("tests/unit/autopilots/test_parameter_names.py", "test_a_development_build_answers_for_the_names_that_it_has")
    ],
    "answers by name": [
        (PARAMETERS, "test_parameters_are_read_and_set_and_put_back"),
        (PARAMETERS, "test_old_news_and_other_names_do_not_settle_a_set"),
    ],
    "integer parameters": [(PARAMETERS, "test_px4_puts_integers_as_bits_and_ardupilot_as_values")],
    "wrong type": [(PARAMETERS, "test_px4_says_the_old_value_to_a_set_of_the_wrong_type_and_is_not_believed")],
    "NaN as a parameter": [(PARAMETERS, "test_what_a_type_cannot_hold_is_refused_before_it_is_sent")],
    "requests of both kinds": [(MACHINES, "test_both_kinds_of_request_get_integer_items_as_often_as_they_come")],
    "read-back differs": [
        ("tests/unit/link/protocols/mission/test_read_back.py", "test_changes_that_mean_nothing"),
        ("tests/unit/link/protocols/mission/test_read_back.py", "test_what_ardupilot_cuts_off_px4_has_to_keep"),
        (STORED, "test_what_a_real_vehicle_stored_is_no_difference"),
        (STORED, "test_a_changed_value_is_reported"),
    ],
    "rally altitudes": [
        ("tests/unit/mission/returns/test_rtl_motion.py", "test_return_altitudes_are_what_each_autopilot_stores")
    ],
    "rally frames": [(STORED, "test_px4_gets_rally_points_in_a_frame_that_it_can_return_to")],
    "checksum of a file": [
        (
            "tests/unit/link/protocols/ftp/test_recorded_files.py",
            "test_recorded_bytes_and_checksum_follow_from_the_size_of_the_pieces",
        ),
        ("tests/bridge/test_files.py", "test_a_wrong_checksum_sends_nothing_twice"),
    ],
    "wrong item": [(MACHINES, "test_invalid_sequence_is_not_fatal")],
    "stalled upload": [(DELIVERY, "test_a_mixed_mission_after_a_stall_is_found_and_mended")],
    "Busy": [
        (MACHINES, "test_busy_after_a_repeated_count_is_forgiven_once_per_repetition"),
        (DELIVERY, "test_our_own_broken_upload_is_taken_up_again"),
    ],
    "lost acknowledgement": [
        (MACHINES, "test_error_after_a_repeated_last_item_says_that_the_acknowledgement_was_lost"),
        ("tests/bridge/test_fleet.py", "test_a_lost_ack_is_made_good_by_reading_back"),
    ],
    "another station": [(DELIVERY, "test_another_station_in_the_way_is_waited_for_and_named_if_it_stays")],
    "items it takes and cannot fly": [
        (DELIVERY, "test_what_px4_takes_and_cannot_mean_is_no_difference_and_what_it_changes_is")
    ],
    "items it does not take": [
        (DELIVERY, "test_what_the_autopilot_does_not_take_is_refused_at_once_with_item_and_reason")
    ],
    "store": [("tests/unit/mission/waypoints/test_mission_items.py", "test_more_items_than_the_autopilot_stores")],
    "wrong fence": [(DELIVERY, "test_a_fence_of_a_wrong_shape_is_not_believed_on_either")],
    "clearing": [(DELIVERY, "test_an_empty_delivery_clears")],
    "reasons": [(PROLOGUE, "test_reasons_come_before_or_after_a_refusal_and_in_pieces")],
    "lost chunks": [
        ("tests/unit/link/protocols/test_statustext.py", "test_chunks_are_joined_in_any_order_and_per_source"),
        ("tests/unit/link/protocols/test_statustext.py", "test_a_missing_chunk_is_shown_as_missing"),
    ],
    "modes acknowledged": [(PROLOGUE, "test_a_mode_is_believed_when_the_heartbeat_shows_it")],
    "MISSION_START": [(PROLOGUE, "test_a_mission_has_begun_when_the_heartbeat_shows_its_mode")],
    "arming": [(PROLOGUE, "test_it_takes_off_in_a_mode_that_flies_no_mission_by_itself")],
    "landed": [("tests/unit/flight/execution/test_fleet_landing.py", "test_landed_is_who_has_disarmed")],
    "items reached": [("tests/unit/docs/test_tables.py", "test_items_reached_are_not_read")],
    "the last setpoint": [
        (STREAM, "test_streams_end_at_rest"),
        ("tests/unit/flight/contingency/test_manoeuvres.py", "test_holding_brakes_straight_on"),
        ("tests/unit/flight/execution/test_deadlines.py", "test_after_a_stall_the_newest_point_alone_is_sent"),
    ],
    "Offboard": [("tests/bridge/test_fly.py", "test_px4_is_flown_as_well")],
    "mode after landing": [("tests/bridge/test_fly.py", "test_px4_is_flown_as_well")],
    "time": [
        ("tests/unit/link/protocols/test_clock.py", "test_unset_gnss_time_says_nothing"),
        ("tests/unit/link/protocols/test_clock.py", "test_prediction_follows_a_vehicle_at_any_rate_through_jitter"),
    ],
    "signatures": [
        ("tests/bridge/test_signing.py", "test_a_vehicle_that_does_not_sign_is_not_believed"),
        ("tests/unit/link/wire/test_signing.py", "test_with_a_key_only_it_is_believed"),
    ],
    "stray bytes": [
        ("tests/property/link/test_codec_fuzz.py", "test_garbage_never_raises_and_a_good_frame_after_it_is_heard")
    ],
    "arrival times": [
        ("tests/unit/autopilots/waypoint_models/test_recordings.py", "test_a_mission_that_was_not_fitted_is_predicted")
    ],
}


def rows(text: str, header: str) -> list[str]:
    """First cells of the table whose header row begins so."""
    lines = iter(text.splitlines())
    for line in lines:
        if line.startswith(f"| {header} |"):
            next(lines)
            break
    found = []
    for line in lines:
        if not line.startswith("|"):
            break
        found.append(line.split("|")[1].strip())
    return found


@pytest.mark.parametrize(
    ("document", "header", "proofs"), [("docs/flying.md", "event", FLOWN), ("docs/autopilots.md", "habit", HABITS)]
)
def test_every_row_has_a_test(
    repo_root: Path, document: str, header: str, proofs: dict[str, list[tuple[str, str]]]
) -> None:
    assert rows((repo_root / document).read_text(), header) == list(proofs)
    assert_tests_exist(repo_root, proofs)


def test_every_rule_has_a_test(repo_root: Path) -> None:
    assert {row.rule for row in POLICY} - {KEEPS} == set(POLICY_PROOFS)
    assert_tests_exist(repo_root, POLICY_PROOFS)


def assert_tests_exist(repo_root: Path, proofs: dict[str, list[tuple[str, str]]]) -> None:
    for tests in proofs.values():
        assert tests
        for path, name in tests:
            assert name in functions(repo_root / path), f"{path}::{name}"


@functools.cache
def functions(file: Path) -> set[str]:
    return {node.name for node in ast.parse(file.read_text()).body if isinstance(node, ast.FunctionDef)}


def test_items_reached_are_not_read(repo_root: Path) -> None:
    """Their numbers are not those of waypoints: nothing may go by them."""
    reading = [path.name for path in (repo_root / "gcs").rglob("*.py") if "MISSION_ITEM_REACHED" in path.read_text()]
    assert reading == []
