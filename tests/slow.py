"""Which tests are slow, and why: what `make test-fast` leaves out. `make coverage` leaves out those of them that run
little of the program in this process, or what the fast ones run already.

A test of the command line that starts the program as a process is slow by itself. The others are named here: a whole
file or one test of it, from the folder of the tests.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

PROCESS: Final = "starts processes"
REAL_TIME: Final = "waits in real time"
FLIGHTS: Final = "whole searches are flown"
REPLAYS: Final = "whole flights are replayed, many times"
EXAMPLES: Final = "hundreds of examples of something long"
PAGES: Final = "all pages are built"
COMPILES: Final = "compiles C, once a worker"
DRAWN: Final = "figures are drawn"
TRIALS: Final = "trials in processes"
WAITS: Final = {PROCESS, REAL_TIME, PAGES}  # while others may compute
SLOW_FIXTURES: Final = {"start": PROCESS, "autopilot": REAL_TIME, "examine": REAL_TIME}

COUNTED: Final = (
    "campaign/",
    "cli/",
    "records/ros_messages/",
    "records/test_pictures.py",
    "search/test_bad_strategies.py",
    "search/test_client.py",
    "search/test_flux.py",
    "search/test_pilot.py",
    "search/test_permission.py",
    "search/test_team.py",
)

SLOW: Final = {
    "autopilot/test_pose_track.py::test_between_samples_it_is_what_scipy_makes_of_them": EXAMPLES,
    "autopilot/test_session.py::test_a_hostile_link_does_not_fill_the_memory": EXAMPLES,
    "bench/test_conform.py": PROCESS,
    "bench/test_pytest_plugin.py": PROCESS,
    "campaign/test_plan.py::test_transmitters_are_drawn_uniformly": EXAMPLES,
    "campaign/test_report.py": EXAMPLES,
    "campaign/test_results.py::test_every_row_is_one_line_and_is_read_as_it_was_written": EXAMPLES,
    "campaign/test_results.py::test_killed_in_the_middle_of_a_write_it_goes_on_without_loss_or_repetition": EXAMPLES,
    "campaign/test_trials.py": TRIALS,
    "cli/test_broken.py::test_a_broken_scenario_is_answered_at_its_place_and_alike_by_check_and_run": EXAMPLES,
    "cli/test_broken.py::test_a_process_ends_with_2_and_no_traceback": PROCESS,
    "cli/test_broken.py::test_a_wrong_command_line_is_answered": EXAMPLES,
    "cli/test_campaign.py": TRIALS,
    "cli/test_commands.py": PROCESS,
    "cli/test_demo.py": FLIGHTS,
    "cli/test_doctor.py": REAL_TIME,
    "cli/test_ends.py": PROCESS,
    "cli/test_far_ends.py": PROCESS,
    "cli/test_links.py": REAL_TIME,
    "cli/test_of_records.py": DRAWN,
    "cli/test_plugins.py": FLIGHTS,
    "cli/test_record.py": PROCESS,
    "cli/test_replay.py": REPLAYS,
    "cli/test_search.py": REAL_TIME,
    "cli/test_web.py": PROCESS,
    "config/test_reference.py::test_the_schema_refuses_what_is_refused_for_its_keys_types_and_ranges": EXAMPLES,
    "config/test_scenario.py::test_any_text_is_a_scenario_or_a_scenario_error": EXAMPLES,
    "config/test_scenario.py::test_so_is_the_default_with_any_piece_replaced": EXAMPLES,
    "config/test_scenario.py::test_written_and_read_back_it_is_equal": EXAMPLES,
    "config/test_spec_2.py::test_written_and_read_back_it_is_equal": EXAMPLES,
    "emulator/test_emulator.py::test_the_whole_chain_over_every_kind_of_link": REAL_TIME,
    "emulator/test_faults.py::test_a_long_run_checks_out": REPLAYS,
    "emulator/test_faults.py::test_a_replay_in_a_clocks_time_sends_late_frames_late_and_the_same_bytes": REPLAYS,
    "emulator/test_faults.py::test_another_fault_does_not_change_whom_this_one_strikes": REPLAYS,
    "emulator/test_faults.py::test_before_and_after_a_fault_the_frames_are_what_they_would_be_without": REPLAYS,
    "emulator/test_faults.py::test_bytes_are_hit_at_the_rate_asked_for": REPLAYS,
    "emulator/test_faults.py::test_every_frame_is_accounted_for_and_every_fault_counted_and_marked": REPLAYS,
    "emulator/test_faults.py::test_frames_inside_mavlink_meet_what_is_sent_and_the_link_stays_whole": REPLAYS,
    "emulator/test_faults.py::test_two_bursts_of_interference_at_once_add_up_whatever_their_order": REPLAYS,
    "emulator/test_faults.py::test_what_is_counted_is_what_is_marked_and_what_a_driver_counts": REPLAYS,
    "emulator/test_faults.py::test_written_and_read_back_they_are_equal": EXAMPLES,
    "emulator/test_many_vehicles.py::test_frames_that_are_due_go_before_the_rest_of_a_flood": EXAMPLES,
    "emulator/test_true_pose.py::test_a_walk_has_its_size_and_its_correlation_time": EXAMPLES,
    "emulator/test_true_pose.py::test_the_noise_of_the_gps_is_an_error_of_what_a_search_reaches": FLIGHTS,
    "firmware_proto/test_c_codec.py": COMPILES,
    "firmware_proto/test_lua_codec.py::test_python_and_lua_make_the_same_of_the_same_bytes": EXAMPLES,
    "firmware_proto/test_lua_codec.py::test_python_and_lua_make_the_same_of_the_same_messages": EXAMPLES,
    "firmware_proto/test_lua_search.py": FLIGHTS,
    "firmware_proto/test_px4_module.py": COMPILES,
    "firmware_proto/test_stm32.py": PROCESS,
    "firmware_proto/test_wire_measured.py::test_an_answer_between_two_frames_changes_neither": EXAMPLES,
    "firmware_proto/test_wire_measured.py::test_what_is_sent_comes_out_cut_anywhere": EXAMPLES,
    "firmware_proto/test_wire_protocol.py::test_any_stream_is_decoded_as_the_rules_read": EXAMPLES,
    "firmware_proto/test_wire_protocol.py::test_cutting_changes_nothing_and_nothing_raises": EXAMPLES,
    "firmware_proto/test_wire_protocol.py::test_every_frame_among_garbage_is_delivered": EXAMPLES,
    "firmware_proto/test_wire_protocol.py::test_work_grows_with_the_bytes_and_no_faster": EXAMPLES,
    "links/test_links_reconnecting.py::test_unplugged_and_plugged_again": REAL_TIME,
    "model/test_keying.py::test_a_timeline_has_every_pulse_once_in_time_with_all_that_touch_it": EXAMPLES,
    "model/test_outputs.py::test_noise_is_bounded_and_uniform_in_direction": EXAMPLES,
    "model/test_paper.py::test_few_transmitters_are_read_as_many_are": EXAMPLES,
    "model/test_paper.py::test_the_whole_chain_agrees_with_an_independent_one": EXAMPLES,
    "model/test_paper.py::test_turning_the_whole_world_changes_nothing": EXAMPLES,
    "observers/test_web.py::test_at_every_time_there_is_what_there_was_in_any_order": EXAMPLES,
    "observers/test_web.py::test_of_a_long_record_no_more_is_sent_than_a_page_can_draw": EXAMPLES,
    "observers/test_web.py::test_a_million_readings_take_bounded_memory_and_the_newest_are_all_there": EXAMPLES,
    "pages/test_build.py": PAGES,
    "pages/test_command_lines.py": PROCESS,
    "pages/test_tutorial.py": REAL_TIME,
    "records/test_comparing.py": FLIGHTS,
    "records/test_exports.py::test_memory_follows_the_file_and_slots_that_are_not_there_cost_nothing": EXAMPLES,
    "records/test_fitting.py": FLIGHTS,
    "records/test_pictures.py": DRAWN,
    "runtime/test_drivers.py::test_nothing_is_asked_twice_of_one_that_stayed": REPLAYS,
    "runtime/test_log_clocks.py": REPLAYS,
    "runtime/test_replay.py": REPLAYS,
    "search/test_bad_strategies.py": FLIGHTS,
    "search/test_client.py": FLIGHTS,
    "search/test_estimate.py::test_a_position_that_drifts_is_averaged_above_the_transmitter": FLIGHTS,
    "search/test_estimate.py::test_a_transmitter_is_found_with_a_receiver_of_any_rate": FLIGHTS,
    "search/test_estimate.py::test_a_transmitter_that_moves_has_a_track_and_the_report_tells_of_it": FLIGHTS,
    "search/test_estimate.py::test_a_transmitter_that_stands_still_has_no_track_though_places_drift": FLIGHTS,
    "search/test_estimate.py::test_before_the_first_signal_it_stays": FLIGHTS,
    "search/test_estimate.py::test_blanks_and_readings_of_another_transmitter_with_its_id_do_not_lead_astray": FLIGHTS,
    "search/test_estimate.py::test_however_it_lies_buried": FLIGHTS,
    "search/test_estimate.py::test_however_it_lies_buried_and_however_strong_it_is": FLIGHTS,
    "search/test_estimate.py::test_readings_that_are_late_are_put_where_they_were_made": FLIGHTS,
    "search/test_estimate.py::test_the_cases_of_the_paper": FLIGHTS,
    "search/test_estimate.py::test_the_same_flight_again": FLIGHTS,
    "search/test_estimate.py::test_though_it_never_comes_above_a_place_again": FLIGHTS,
    "search/test_estimate.py::test_though_its_cause_changes_whenever_it_looks": FLIGHTS,
    "search/test_estimate.py::test_with_a_position_that_is_not_known_well_and_at_any_rate": FLIGHTS,
    "search/test_estimate.py::test_with_an_uncertain_position_it_reports_a_place_from_a_reading_beside_it": FLIGHTS,
    "search/test_flights.py": FLIGHTS,
    "search/test_flux.py::test_a_centre_that_swings_about_the_place_is_there": FLIGHTS,
    "search/test_flux.py::test_a_higher_speed_ends_sooner_though_the_vehicle_is_slow_to_follow": FLIGHTS,
    "search/test_flux.py::test_below_a_slope_the_depth_counts_from_the_ground": FLIGHTS,
    "search/test_flux.py::test_goes_back_to_where_it_was_heard_best": FLIGHTS,
    "search/test_flux.py::test_goes_to_what_it_has_found": FLIGHTS,
    "search/test_flux.py::test_needs_no_direction": FLIGHTS,
    "search/test_flux.py::test_never_too_fast": FLIGHTS,
    "search/test_flux.py::test_no_false_minimum_holds_it": FLIGHTS,
    "search/test_flux.py::test_readings_of_one_that_has_moved_contradict_the_place_judged_before": FLIGHTS,
    "search/test_flux.py::test_readings_that_are_no_numbers_say_nothing": FLIGHTS,
    "search/test_flux.py::test_sees_the_minimum_from_a_circle_round_it": FLIGHTS,
    "search/test_flux.py::test_the_attitude_of_a_reading_is_that_of_its_own_pose": FLIGHTS,
    "search/test_flux.py::test_the_same_d_everywhere_is_no_transmitter": FLIGHTS,
    "search/test_flux.py::test_what_readings_of_five_seconds_ago_lead_to_does_not_agree": FLIGHTS,
    "search/test_flux.py::test_what_was_found_agrees_and_what_lies_elsewhere_does_not": FLIGHTS,
    "search/test_permission.py": FLIGHTS,
    "search/test_permission.py::test_it_says_in_order_what_a_search_orders_and_orders_nothing": FLIGHTS,
    "search/test_pilot.py": FLIGHTS,
    "search/test_team.py::test_a_team_finds_every_transmitter_once_and_its_vehicles_keep_apart": FLIGHTS,
    "search/test_team.py::test_beside_a_liar_two_searches_end_and_keep_off_the_ground_and_each_other": FLIGHTS,
    "search/test_team.py::test_the_pilot_of_one_drone_takes_over_that_one_and_no_other": FLIGHTS,
    "search/test_team.py::test_who_takes_off_late_waits_until_nobody_is_above": FLIGHTS,
    "search/test_victims.py": FLIGHTS,
    "simulated/test_simulated_vehicle.py::test_garbage_is_dropped": EXAMPLES,
    "simulated/test_simulated_vehicle.py::test_the_motion_is_one_motion": EXAMPLES,
    "sitl/test_search_flies.py": REAL_TIME,
    "test_golden_frames.py": REPLAYS,
    "test_public_api.py::test_a_live_run_serves_every_vehicle_of_a_scenario": REAL_TIME,
    "tools/test_tools.py": PROCESS,
    "tools/test_tools.py::test_a_figure_is_a_small_file": DRAWN,
    "tools/test_tools.py::test_a_figure_is_within_its_tolerance": EXAMPLES,
    "tools/test_tools.py::test_a_flux_line_keeps_its_apex": DRAWN,
    "tools/test_tools.py::test_a_grid_reaches_both_sides_and_has_the_transmitter": DRAWN,
    "tools/test_tools.py::test_a_turned_receiver_may_be_deaf_outside_the_inner_zone_and_hears_no_farther": DRAWN,
    "tools/test_tools.py::test_an_iso_power_line_is_of_one_power_and_bears_what_is_shown_there": DRAWN,
    "tools/test_tools.py::test_directions_are_the_field_s_as_far_as_noise_and_whole_degrees_allow": DRAWN,
    "tools/test_tools.py::test_every_figure_is_kept_beside_the_tools": DRAWN,
    "tools/test_tools.py::test_level_poses_are_level_in_the_plane_and_the_others_turned_in_every_way": DRAWN,
    "tools/test_tools.py::test_level_receivers_all_hear_near_and_none_hears_far": DRAWN,
    "tools/test_tools.py::test_marks_fail_for_who_follows_the_nearest_of_four_old_sets_now_and_then": EXAMPLES,
    "tools/test_tools.py::test_no_order_comes_later_than_the_bound": REAL_TIME,
    "tools/test_tools.py::test_pulses_of_several_sets_touch_as_often_as_the_table_says": EXAMPLES,
    "tools/test_tools.py::test_readings_are_what_a_receiver_says": DRAWN,
    "tools/test_tools.py::test_share_heard": DRAWN,
    "tools/test_tools.py::test_the_command_writes_every_figure_where_it_is_told": DRAWN,
    "tools/test_tools.py::test_the_field_is_that_of_a_dipole_that_points_east": DRAWN,
    "tools/test_tools.py::test_the_same_seed_gives_the_same_data_and_another_gives_others": DRAWN,
}


def reason(path: str, name: str, fixtures: list[str]) -> str | None:
    """Why a test is slow, None if it is not. `path`: of its file, from the folder of the tests."""
    for fixture in fixtures:
        if path.startswith("cli/") and fixture in SLOW_FIXTURES:
            return SLOW_FIXTURES[fixture]
    return SLOW.get(path) or SLOW.get(f"{path}::{name}")


def counted(path: str, fixtures: list[str]) -> bool:
    """Whether a slow test counts for the coverage."""
    return path.startswith(COUNTED) and "start" not in fixtures


def strangers(tests: Path) -> list[str]:
    """Those of `SLOW` that are no file or no test any more."""
    kept = {entry: (tests / entry.partition("::")[0], entry.partition("::")[2]) for entry in SLOW}
    return [
        entry
        for entry, (file, name) in kept.items()
        if not file.exists() or (name and f"def {name}(" not in file.read_text())
    ]
