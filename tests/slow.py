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
    "search/test_estimate.py",
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
    "emulator/test_faults.py": REPLAYS,
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
    "observers/test_web.py::test_at_every_time_a_vehicle_has_its_health_of_then": EXAMPLES,
    "observers/test_web.py::test_events_that_are_not_as_expected_do_no_harm": EXAMPLES,
    "observers/test_web.py::test_at_every_time_there_is_what_there_was_in_any_order": EXAMPLES,
    "observers/test_web.py::test_a_map_file_lies_where_it_is_on_earth": DRAWN,
    "observers/test_web.py::test_of_a_long_record_no_more_is_sent_than_a_page_can_draw": EXAMPLES,
    "observers/test_web.py::test_many_readings_take_bounded_memory_and_the_newest_are_all_there": EXAMPLES,
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
    "search/test_estimate.py": FLIGHTS,
    "search/test_flights.py": FLIGHTS,
    "search/test_flux.py": FLIGHTS,
    "search/test_permission.py": FLIGHTS,
    "search/test_pilot.py": FLIGHTS,
    "search/test_team.py": FLIGHTS,
    "search/test_victims.py": FLIGHTS,
    "simulated/test_simulated_vehicle.py::test_garbage_is_dropped": EXAMPLES,
    "simulated/test_simulated_vehicle.py::test_the_motion_is_one_motion": EXAMPLES,
    "sitl/test_search_flies.py": REAL_TIME,
    "test_golden_frames.py": REPLAYS,
    "test_public_api.py::test_a_live_run_serves_every_vehicle_of_a_scenario": REAL_TIME,
    "tools/test_tools.py": PROCESS,
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
