"""Events and reasons are frozen values, and each has its words."""

from __future__ import annotations

import json
from dataclasses import FrozenInstanceError, asdict, replace
from typing import Any

import pytest

from arva_hil import events
from arva_hil.events import DatumSet, Event, LinkBack, LinkEvent, LinkLost, searches, vehicles
from arva_hil.events.event_json import NOT_NEWS, event_json, event_name, event_of
from arva_hil.events.reasons import HeardSource, NoPose, NoVehicle, SilentStream, Why, because
from arva_hil.events.searches import OrderDetail, SearchEnded, WouldOrder
from arva_hil.events.words.reasons import _WORDS, in_words, no_pose, no_vehicle
from arva_hil.events.words.sentences import sentence
from arva_hil.events.words.text import Notice, in_metres, reading, sigma
from firmware_proto import INNER, MID, OUTER, Channel
from tests.every import every


def test_an_event_is_a_frozen_dataclass_with_the_fields_of_its_bases_first() -> None:
    lost, back = LinkLost(1.0, "autopilot", "pty", "gone"), LinkBack(1.0, "autopilot", "pty", 2.0)
    assert asdict(lost) == {"time_s": 1.0, "link": "autopilot", "address": "pty", "reason": "gone"}
    assert len({lost, back, replace(lost)}) == 2
    assert isinstance(lost, LinkEvent)
    with pytest.raises(FrozenInstanceError):
        lost.reason = "another"  # type: ignore[misc]


# -- What a person sees of a reading: nothing that means nothing ------------------------------------------


@every(
    "channels, said",
    [
        ([Channel(1, MID, 1046, 12)], "#1 mid 1046 cm +12°"),
        ([Channel(1, INNER, 85, 0)], "#1 inner 85 cm"),
        ([Channel(None, OUTER, 1234, -17)], "#? 1234 cm -17°"),  # plain text carries no zone
        ([Channel(3, 7, 400, 0)], "#3 zone 7 400 cm +0°"),
        ([Channel(), Channel(1, MID, 0, 5)], "no signal"),
        ([Channel(2, INNER, 90, 0), Channel(5, MID, 700, 0), Channel()], "#2 inner 90 cm, #5 mid 700 cm +0°"),
    ],
)
def test_a_direction_and_a_zone_are_shown_only_where_there_is_one(channels: list[Channel], said: str) -> None:
    assert reading(channels) == said


@every(
    "metres, error, spread",
    [
        (0.0, "less than 1 cm", "less than 1 cm"),
        (0.0099, "less than 1 cm", "less than 1 cm"),
        (0.01, "0.01 m", "1 cm"),
        (0.04, "0.04 m", "4 cm"),
        (0.55, "0.55 m", "0.6 m"),
    ],
)
def test_an_error_is_never_printed_as_zero(metres: float, error: str, spread: str) -> None:
    assert (in_metres(metres), sigma(metres)) == (error, spread)


# -- Reasons in words: every kind has some, and a record has them in place of the values ------------------


FLOWN = because(Why.STRIPS_FLOWN, heard=True, twice=True, team=False, found=0, wanted=1, more=0)
MOVED = DatumSet(1.0, "vehicle", 46.0, 7.0, 1650.0, (because(Why.HOME_MOVED),))


def test_every_kind_of_reason_has_words() -> None:
    assert set(_WORDS) == set(Why)


def test_several_reasons_are_one_sentence_and_none_is_empty() -> None:
    taken = because(Why.MODE_TAKEN, mode="LOITER", stalled_s=0.0), because(Why.NOT_TAKEN_OVER)
    assert in_words(taken) == "the mode is LOITER: the pilot or a failsafe has taken over; it was not taken over"
    assert in_words(()) == in_words(None) == ""


@every(
    "found, wanted, words",
    [
        (0, 3, "not found in 900 s"),
        (2, 3, "2 of 3 found in 900 s"),
        (2, None, "2 found in 900 s, 1 more received"),
    ],
)
def test_a_search_whose_time_is_up_says_how_many_it_has_found(found: int, wanted: int | None, words: str) -> None:
    assert in_words(because(Why.TIME_UP, limit_s=900.0, found=found, wanted=wanted, more=1)) == words


@every(
    "event, field, words",
    [
        (SearchEnded(1.0, (FLOWN,), True), "how", "no signal agrees with a place: all strips are flown, twice"),
        (MOVED, "reason", "home has moved"),
        (DatumSet(1.0, "vehicle", 46.0, 7.0, 1650.0, ()), "reason", ""),
        (WouldOrder(1.0, "DO_SET_MODE", OrderDetail("GUIDED", at_end=True)), "what", "GUIDED, at the end"),
        (WouldOrder(1.0, "NAV_TAKEOFF", OrderDetail(height_m=3.0)), "what", "to 3 m above the take-off point"),
        (WouldOrder(1.0, "COMPONENT_ARM_DISARM", OrderDetail()), "what", "arm"),
    ],
)
def test_a_record_has_the_words_and_gives_the_same_sentence(event: Event, field: str, words: str) -> None:
    said = json.loads(event_json(event) or "")
    assert said[field] == words
    read = event_of(said)
    assert read is not None
    assert sentence(read) == sentence(event)


# -- Every event in words and as a JSON object: the one place where the exact sentences are asserted ------


LINK = (1.0, "autopilot", "udpin:127.0.0.1:14550")
RECEIVER = (1.0, "vehicle", "receiver")
VEHICLE = (1.0, "vehicle")
LABEL = "px4 quadrotor 1/1"
NO_ATTITUDE = NoPose("streams missing", (SilentStream("ATTITUDE", "", 0.0, "", False, False),))
DENIED = ("ATTITUDE", "SET_MESSAGE_INTERVAL", 50.0, "MAV_RESULT_DENIED")
SILENT = "transmitters that follow it are silent until its GLOBAL_POSITION_INT and ATTITUDE come on one of the links"
CURE = "correct `datum` and `transmitters` in the scenario, or use `datum: home`"

SENTENCES: list[tuple[Event, str, str]] = [
    (events.ObserverFailed(1.0, "Disk", "OSError()"), "error", "Disk has failed and is switched off: OSError()"),
    (events.LinkLost(*LINK, "ttyUSB0: lost"), "warning", "ttyUSB0: lost"),
    (events.LinkBlocked(*LINK, "ttyUSB0: busy"), "warning", "ttyUSB0: busy"),
    (events.LinkThere(*LINK), "info", "udpin:127.0.0.1:14550: is open"),
    (events.LinkBack(*LINK, 2.04), "info", "udpin:127.0.0.1:14550: back after 2.0 s"),
    (events.LinkBack(*LINK, 0.0), "info", "udpin:127.0.0.1:14550: back"),
    (
        events.StrangersIgnored(*LINK, "10.0.0.1:9"),
        "info",
        "udpin:127.0.0.1:14550: other senders than its peer are ignored; the first was 10.0.0.1:9",
    ),
    (
        events.LogLayout(0.0, "a.tlog", ""),
        "info",
        "a.tlog: it has no time stamps: times come from the vehicles' boot times",
    ),
    (
        events.LogClockSet(0.0, "a.tlog"),
        "warning",
        "a.tlog: the clock of its computer was set during the recording: the vehicles' clocks are used instead",
    ),
    (
        events.FollowedSystemSilent(1.0, 7, True),
        "warning",
        f"system 7 sends nothing any more: {SILENT}",
    ),
    (events.FollowedSystemSilent(1.0, 7, False), "warning", f"system 7 never sent anything: {SILENT}"),
    (events.FollowedSystemHeard(1.0, 7), "info", "system 7 sends its position: transmitters follow it"),
    (
        events.ReceiverRestarted(*RECEIVER, 140, 0),
        "warning",
        "the receiver has restarted: frame 0 follows frame 140",
    ),
    (events.CommandReceived(*RECEIVER, 7, "mark", (3,)), "info", "command 7 of the host: mark 3"),
    (
        events.CommandAnswered(*RECEIVER, 7, "identify", "done", (4,), "paper 1.0 binary", True),
        "info",
        "command 7 answered: done paper 1.0 binary 4",
    ),
    (
        events.CommandAnswered(*RECEIVER, 8, "mark", "refused", (), "", False),
        "info",
        "command 8 answered: refused, which no program took",
    ),
    (
        events.FramesLate(*RECEIVER, 0.137),
        "warning",
        "its frames are late, now by 137 ms: this machine is overloaded; serve fewer vehicles, or lower rate_hz",
    ),
    (events.FramesRefused(*RECEIVER), "warning", "no program takes the frames: they are dropped until one reads them"),
    (events.FramesTaken(*RECEIVER, 7), "info", "frames are taken; 7 were dropped so far"),
    (events.PoseFound(*RECEIVER), "info", "there is a pose: readings are real from here on"),
    (
        events.PoseLost(*RECEIVER, 2.04, NO_ATTITUDE),
        "warning",
        "no pose: frames have no signal until there is one (the newest is 2.0 s old)",
    ),
    (
        events.PoseLost(*RECEIVER, None, NO_ATTITUDE),
        "warning",
        "no pose: frames have no signal until there is one (no ATTITUDE (not asked for yet))",
    ),
    (
        events.PoseMissing(*RECEIVER, NoPose("no home")),
        "warning",
        "still no pose, frames have no signal: waiting for HOME_POSITION",
    ),
    (
        events.TooFar(*RECEIVER, 2500.0, 2400.0, True),
        "warning",
        f"the vehicle is 2.5 km from the datum and 2.4 km from the nearest transmitter, too far to receive it: {CURE}",
    ),
    (
        events.GroundMissing(*VEHICLE, [3], "autopilot"),
        "warning",
        "the ground is not known at these transmitters, which are silent: 3. The autopilot has not sent it yet: its "
        "terrain data must be switched on and loaded",
    ),
    (
        events.GroundMissing(*VEHICLE, [3, 4], "a.asc"),
        "warning",
        "the ground is not known at these transmitters, which are silent: 3 4. a.asc has no height there or at the "
        "datum: is it of this place?",
    ),
    (
        events.MotorsSilent(*VEHICLE, 0.5),
        "warning",
        "the vehicle does not report its motors' load (VFR_HUD, BATTERY_STATUS): their noise stays that of 50% load",
    ),
    (
        events.MotorsHeard(*VEHICLE),
        "info",
        "the vehicle reports its motors' load",
    ),
    (
        events.GroundFound(*VEHICLE),
        "info",
        "the autopilot has sent the height of the ground: all transmitters send",
    ),
    (
        events.DatumSet(*VEHICLE, 46.5, 11.35, 1800.0, (because(Why.HOME_MOVED),)),
        "info",
        "datum: 46.5000000, 11.3500000, 1800.00 m AMSL (home has moved)",
    ),
    (vehicles.VehicleFound(*VEHICLE, LABEL, 2, True), "info", "vehicle px4 quadrotor 1/1, MAVLink 2, signed"),
    (
        vehicles.SignaturesUnchecked(*VEHICLE),
        "warning",
        "its packets are signed. They are not checked, and it may refuse unsigned requests: use --signing-key FILE",
    ),
    (vehicles.VehicleLost(*VEHICLE, LABEL, 5.0), "warning", "no heartbeat from vehicle px4 quadrotor 1/1 for 5 s"),
    (vehicles.VehicleBack(*VEHICLE, LABEL), "info", "vehicle px4 quadrotor 1/1 is back"),
    (vehicles.VehicleRebooted(*VEHICLE, LABEL), "warning", "vehicle px4 quadrotor 1/1 has rebooted: a new session"),
    (
        vehicles.OtherAutopilotIgnored(*VEHICLE, 2, 1, False),
        "info",
        "another autopilot 2/1 on this link is ignored; choose one with --target-system",
    ),
    (
        vehicles.OtherAutopilotIgnored(*VEHICLE, 1, 1, True),
        "info",
        "another autopilot 1/1 on this link is ignored; it has the same ids as this one: change them",
    ),
    (
        vehicles.SignatureRefused(*VEHICLE, 1, 1, "unsigned"),
        "warning",
        "unsigned packets are ignored, the first from 1/1: does it have the key (SETUP_SIGNING)?",
    ),
    (
        vehicles.SignatureRefused(*VEHICLE, 1, 1, "forged"),
        "warning",
        "packets signed with another key are ignored, the first from 1/1",
    ),
    (
        vehicles.SignatureRefused(*VEHICLE, 1, 1, "replayed"),
        "warning",
        "packets with old time stamps are ignored, the first from 1/1: replayed, or its clock is behind",
    ),
    (
        vehicles.ClockLeapt(*VEHICLE, 41.52),
        "info",
        "the vehicle's clock is ahead by 42 s: earlier packets came late",
    ),
    (vehicles.PositionJumped(*VEHICLE, 5566.2), "warning", "the vehicle's position has jumped by 5566 m"),
    (
        vehicles.StreamRateLowered(*VEHICLE, *DENIED, 25.0),
        "warning",
        "ATTITUDE: SET_MESSAGE_INTERVAL to 50 Hz: MAV_RESULT_DENIED; asking for 25 Hz",
    ),
    (
        vehicles.StreamAskedOtherwise(*VEHICLE, "ATTITUDE", "SET_MESSAGE_INTERVAL", 50.0, "", 50.0),
        "warning",
        "ATTITUDE is slower than the 50 Hz wanted (SET_MESSAGE_INTERVAL: no answer); trying REQUEST_DATA_STREAM",
    ),
    (vehicles.AutopilotText(*VEHICLE, "PreArm: x"), "warning", "the autopilot reports: PreArm: x"),
    (vehicles.ArmingTried(*VEHICLE, 1, 3.0, "", ""), "info", "arming, try 1; next try in 3 s"),
    (
        vehicles.ArmingTried(*VEHICLE, 2, 3.0, "arming", "FAILED"),
        "info",
        "arming, try 2; next try in 3 s; the last one was refused: arming: FAILED",
    ),
    (
        vehicles.ThrottleAwaited(*VEHICLE, 2, 120),
        "warning",
        "the pilot has moved a stick (channel 2, by 120 µs): the vehicle hovers in GUIDED until the throttle stick is "
        "in the middle, then LOITER is ordered",
    ),
    (
        vehicles.ThrottleAwaited(*VEHICLE, 0, 0),
        "warning",
        "the battery: the vehicle hovers in GUIDED until the throttle stick is in the middle, then LOITER is ordered",
    ),
    (
        vehicles.ThrottleAwaited(1.0, "drone", 7, 500),
        "warning",
        "the pilot has moved a switch (channel 7, by 500 µs): the vehicle hovers in GUIDED until the throttle stick is "
        "in the middle, then LOITER is ordered",
    ),
    (searches.FromSearch(1.0, searches.DescentBegun(1.0)), "info", "search: descending to the place reported"),
    (searches.WaitingFor(1.0, "frame"), "info", "waiting for a frame from the receiver"),
    (
        searches.FailsafesKnown(1.0, "px4", (("COM_OBL_RC_ACT", 4.0), ("COM_OF_LOSS_T", 1.0), ("NAV_RCL_ACT", 2.0))),
        "info",
        "without set-points it lands (COM_OBL_RC_ACT 4) after 1 s (COM_OF_LOSS_T); without a radio: "
        "Return (NAV_RCL_ACT 2); without a ground station: unknown (NAV_DLL_ACT)",
    ),
    (
        searches.FailsafesKnown(1.0, "px4", (("COM_OBL_RC_ACT", 0.0), ("NAV_RCL_ACT", 2.0), ("COM_RC_OVERRIDE", 3.0))),
        "info",
        "without set-points it goes to Position mode (COM_OBL_RC_ACT 0) after an unknown time (COM_OF_LOSS_T), and "
        "sinks there and lands where it is, because it has no remote control; without a radio: Return (NAV_RCL_ACT 2); "
        "without a ground station: unknown (NAV_DLL_ACT); if a stick moves: PX4 follows it, in its "
        "auto modes and in OFFBOARD (COM_RC_OVERRIDE 3)",
    ),
    (
        searches.ParameterDoubted(1.0, "GUID_TIMEOUT", 0.1, "set-points too rare"),
        "warning",
        "GUID_TIMEOUT is 0.1: the vehicle may stop between two set-points, which come every 0.2 s; set it to 1 to 3 s",
    ),
    (
        searches.FailsafesKnown(1.0, "ardupilot", (("FS_OPTIONS", 4.0), ("GUID_TIMEOUT", 3.0), ("FS_GCS_ENABLE", 0.0))),
        "info",
        "without set-points it stops after 3 s (GUID_TIMEOUT), and hovers in GUIDED, armed, until the pilot "
        "takes control; without a radio: nothing in GUIDED (FS_OPTIONS 4); without a ground station: nothing "
        "(FS_GCS_ENABLE 0)",
    ),
    (
        searches.SimulatorRecognized(1.0, LABEL, "SIM_STATE"),
        "info",
        "px4 quadrotor 1/1 is a simulator: it answers with SIM_STATE",
    ),
    (
        searches.ArmingAllowed(1.0, LABEL),
        "warning",
        "px4 quadrotor 1/1 is not known to be a simulator; --yes allows the flight",
    ),
    (
        searches.ConsentNeeded(1.0, LABEL, True),
        "warning",
        "px4 quadrotor 1/1 is not known to be a simulator: before it flies, you would have to type yes here",
    ),
    (
        searches.ConsentNeeded(1.0, LABEL, False),
        "warning",
        "px4 quadrotor 1/1 is not known to be a simulator: before it flies, it would need --yes, because there is no "
        "terminal to ask at",
    ),
    (
        searches.DryRunBegun(1.0, LABEL, False, 3.0),
        "info",
        "dry run: all is ready. px4 quadrotor 1/1 would be launched after a count-down of 3 s, by these orders:",
    ),
    (
        searches.DryRunBegun(1.0, LABEL, True, 0.0),
        "info",
        "dry run: all is ready. px4 quadrotor 1/1 would be taken over in the air, by these orders:",
    ),
    (searches.WouldOrder(1.0, "DO_SET_MODE", searches.OrderDetail("hold")), "info", "  DO_SET_MODE: hold"),
    (
        searches.SetPointPlanned(1.0, 0.5, -0.001, 0.0, 30.4, 5.0),
        "info",
        "  SET_POSITION_TARGET_LOCAL_NED: 0.50 m/s north, 0.00 m/s east, 0.00 m/s down, heading 30°, 5 times a second",
    ),
    (searches.CountDown(1.0, 3, False), "info", "arming in 3 s"),
    (searches.CountDown(1.0, 3, True), "info", "taking over in 3 s"),
    (searches.Launched(1.0, LABEL, False), "info", "arming px4 quadrotor 1/1"),
    (searches.Launched(1.0, LABEL, True), "info", "taking over px4 quadrotor 1/1"),
    (searches.SearchBegun(1.0, 2.96), "info", "3.0 m high: the search begins"),
    (searches.SearchEnded(1.0, (because(Why.FOUND),), True), "info", "found; landing"),
    (searches.SearchEnded(1.0, (because(Why.FOUND),), False), "info", "found; hovering"),
    (searches.SearchInterrupted(1.0, "flying"), "info", "interrupted: the vehicle stays hovering"),
    (searches.SearchInterrupted(1.0, "arming"), "info", "interrupted: the vehicle is disarmed"),
    (
        searches.SearchInterrupted(1.0, "landing"),
        "info",
        "interrupted: the vehicle lands; the mode switch stops it",
    ),
    (searches.SearchInterrupted(1.0, "yielding"), "info", "interrupted: the pilot gets the vehicle"),
    (
        searches.SearchHeldUp(1.0, 1.54),
        "warning",
        "the search did nothing for 1.5 s: first it checks who controls the vehicle",
    ),
    (
        searches.StrategySlow(1.0, 10.04, 0.3),
        "warning",
        "the strategy has not answered for 10.0 s, 0.3 s of them without a processor: the vehicle hovers until it does",
    ),
    (searches.SearchPaused(1.0, "no frame", 2.0, 3.0), "warning", "no frame for 2 s: hovering"),
    (
        searches.SearchPaused(1.0, "same readings", 2.0, 3.0),
        "warning",
        "the readings did not change over 3 m of flight: hovering",
    ),
    (searches.SearchResumed(1.0, "no frame"), "info", "frames are back: the search goes on"),
    (searches.SearchResumed(1.0, "same readings"), "info", "the readings change again: the search goes on"),
    (
        searches.OwnMarkHeard(1.0),
        "error",
        "the autopilot receives the vehicle of --gcs, and may evade it: nothing is sent there now",
    ),
    (searches.ReceiverGone(1.0, "pty: lost"), "warning", "the receiver is gone: pty: lost"),
    (
        searches.TransmitterHeard(1.0, 2, 20.0, 3.0, -0.01),
        "info",
        "received transmitter 2, 20.0 m away, at 3.0 m north, 0.0 m east of the take-off point",
    ),
    (
        searches.TransmitterChosen(1.0, None, 9.0),
        "info",
        "going for transmitter without a number, 9.0 m away",
    ),
    (
        searches.TransmitterLeft(1.0, 4),
        "info",
        "transmitter 4 is left to another search",
    ),
    (
        searches.TeammateLost(1.0, 3, 4.0, -2.5, 9.0),
        "warning",
        "the search of vehicle 3 sends nothing any more: this one stays 9 m from where it was, 4.0 m north, 2.5 m "
        "west of the take-off point",
    ),
    (searches.TeammateBack(1.0, 3), "info", "the place of vehicle 3 is known again"),
    (
        searches.TransmitterFaded(1.0, 1, noise=True),
        "warning",
        "the flux lines of transmitter 1 point anywhere, as noise: back to the search strips",
    ),
    (
        searches.TransmitterFaded(1.0, 1),
        "warning",
        "transmitter 1 is not received any more: back to the search strips",
    ),
    (
        searches.VictimNoted(1.0, 3, 1, 2, 4.2, -1.0, True, True, 1, False),
        "info",
        "victim 1 of 2: transmitter 3 at 4.2 m north, 1.0 m west of the take-off point, marked by the receiver; "
        "1 more received",
    ),
    (
        searches.VictimNoted(1.0, None, 2, None, 4.2, -1.0, False, False, None, False),
        "info",
        "victim 2: transmitter without a number at 4.2 m north, 1.0 m west of the take-off point, not sure, "
        "recorded, not marked",
    ),
    (
        searches.VictimAgain(1.0, 5, 1, 0.5),
        "warning",
        "this is victim 1 again, as transmitter 5: 0.5 m from the place recorded",
    ),
    (
        searches.PlaceDoubted(1.0, 5, 1.0, 2.0),
        "warning",
        "the readings of transmitter 5 contradict the place, or ± relative to the drone is above 0.4 m: the search "
        "flies to it once more",
    ),
    (
        searches.TransmitterMoves(1.0, 5, 0.94, 4.4, -2.6),
        "warning",
        "transmitter 5 moves, at about 0.9 m/s: a rescuer who transmits? It is put aside, last 4.4 m north, 2.6 m west "
        "of the take-off point",
    ),
    (
        searches.ReceiverTurned(1.0, 5, -10.4),
        "warning",
        "the receiver is turned by some -10° from its reported heading: check compass and --mount. The place allows "
        "for it",
    ),
    (searches.ReceiverKnown(1.0, "pulsed 1.0 binary", 4), "info", "the receiver is pulsed 1.0 binary"),
    (
        searches.MarksNotTaken(1.0, "unknown"),
        "warning",
        "the receiver cannot mark transmitters (unknown): victims are only recorded",
    ),
    (searches.MarkLost(1.0, 3, 1), "warning", "the receiver has lost the mark of victim 1"),
    (searches.DescentBegun(1.0), "info", "descending to the place reported"),
    (searches.TooLow(1.0, 1.4, 3.0), "warning", "only 1.4 m above the ground, 3 m are wanted: climbing"),
    (
        searches.FenceInArea(1.0, "FENCE_RADIUS", 50.0, 70.7),
        "warning",
        "the area reaches 71 m from the take-off point, beyond the vehicle's fence (FENCE_RADIUS 50): the vehicle does "
        "not fly beyond it",
    ),
    (
        searches.FenceInArea(1.0, "FENCE_TOTAL", 5, 0.0),
        "warning",
        "the vehicle has a fence of its own shape, which is not compared with the area (FENCE_TOTAL 5): the vehicle "
        "does not fly beyond it",
    ),
    (
        searches.SetPointsNotFollowed(1.0, 5.0, 5.0, 0.13),
        "warning",
        "the vehicle does not follow its set-points: 0.1 m in 5 s, 5.0 m ordered: a fence or an obstacle ahead "
        "(AVOID_ENABLE, CP_DIST), or set-points are lost on the link. It flies sideways once",
    ),
    (
        searches.SensorsDisagree(1.0, "rangefinder", 8.04, "vertical speed", 3.0),
        "warning",
        "the rangefinder says 8.0 m, and the vertical speed 3.0 m: the search flies by the lower height",
    ),
    (searches.HeightSource(1.0, "rangefinder"), "info", "height above the ground: from the rangefinder"),
    (
        searches.HeightSource(1.0, "terrain", 10.0),
        "info",
        "the autopilot's terrain data say that the ground falls: the search follows it, 10 m higher than asked",
    ),
    (
        searches.HeightSource(1.0, "doubtful terrain"),
        "warning",
        "the autopilot's terrain data do not agree with its position, and are ignored: the height is held above the "
        "take-off point",
    ),
    (
        searches.HeightSource(1.0, "highest ground"),
        "warning",
        "the rangefinder gives no usable values: the height is held above the highest ground that it measured",
    ),
    (
        searches.HeightSource(1.0, "estimate"),
        "warning",
        "no rangefinder sends values: the height is held above the take-off point; over a slope the height above the "
        "ground is different",
    ),
]
UNSAID = events.HeartbeatMissing(*VEHICLE, NoVehicle("no packets", bytes=150))  # it is how a run ends


def kinds() -> set[type[Event]]:
    """The kinds of events that happen: those without kinds of their own."""
    found = {
        kind
        for room in (events, vehicles, searches)
        for kind in vars(room).values()
        if isinstance(kind, type) and issubclass(kind, Event)
    }
    return {kind for kind in found if not any(issubclass(other, kind) for other in found - {kind})}


@every("event, level, text", SENTENCES)
def test_an_event_in_words(event: Event, level: Any, text: str) -> None:
    assert sentence(event) == Notice(level, text)


def test_that_there_is_no_vehicle_is_how_a_run_with_one_ends_and_news_where_there_are_others() -> None:
    assert sentence(UNSAID) is None
    told = sentence(UNSAID, named=True)
    assert told.text.startswith("vehicle: 150 bytes came, but no MAVLink packet")
    assert "waiting" not in told.text  # it is said at the end of a log and of a run too


def test_there_are_words_for_every_event_that_is_news() -> None:
    assert kinds() == {type(event) for event, _, _ in SENTENCES} | set(NOT_NEWS) | {type(UNSAID)}


@every("event", [UNSAID, *(event for event, _, _ in SENTENCES)])
def test_an_event_as_json_has_a_name_a_time_and_no_objects_inside(event: Event) -> None:
    made = json.loads(event_json(event) or "")
    inner = event.event if isinstance(event, searches.FromSearch) else event
    assert made["event"] == event_name(type(inner))
    assert made["time_s"] == event.time_s
    assert not any(isinstance(value, dict) for value in made.values())


def test_json_names_follow_from_the_class_and_fields_of_fields_are_joined() -> None:
    lost = events.PoseLost(31.4, "vehicle", "receiver", None, NO_ATTITUDE)
    assert json.loads(event_json(lost) or "") == {
        "event": "pose_lost",
        "time_s": 31.4,
        "vehicle": "vehicle",
        "receiver": "receiver",
        "age_s": None,
        "lacking_reason": "streams missing",
        "lacking_message": "",
        "lacking_streams": [["ATTITUDE", "", 0.0, "", False, False]],
    }
    landing = searches.FromSearch(2.0, searches.SearchEnded(2.0, (because(Why.FOUND),), True))
    assert json.loads(event_json(landing) or "") == {
        "event": "search_ended",
        "time_s": 2.0,
        "how": "found",
        "landing": True,
        "by": "search",
    }


def test_a_number_that_is_none_is_null() -> None:
    assert json.loads(event_json(searches.TooLow(1.0, float("nan"), 3.0)) or "")["height_m"] is None


@every(
    "why, text",
    [
        (NoPose("no vehicle"), "no vehicle yet"),
        (NoPose("zero position"), "the position is all zeros: no GPS fix yet"),
        (
            NoPose("zero position", NO_ATTITUDE.streams),
            "the position is all zeros: no GPS fix yet, no ATTITUDE (not asked for yet)",
        ),
        (NoPose("impossible position"), "the position is out of range: no GPS fix yet"),
        (NoPose("streams stopped"), "the streams have stopped"),
        (
            NoPose("no truth", message="SIM_STATE"),
            "no SIM_STATE: only a simulator sends its vehicle's true pose; use `pose: estimate` otherwise",
        ),
        (
            NoPose("no truth"),
            "only the simulators of ArduPilot and PX4 send their vehicle's true pose; use `pose: estimate` otherwise",
        ),
        (
            NoPose("streams missing", (SilentStream("ATTITUDE", "", 0.0, "", True, False),)),
            "no ATTITUDE (none in the log lately)",
        ),
        (
            NoPose("streams missing", (SilentStream("ATTITUDE", "REQUEST_DATA_STREAM", 4.0, "", False, False),)),
            "no ATTITUDE (REQUEST_DATA_STREAM at 4 Hz: never acknowledged)",
        ),
        (
            NoPose(
                "streams missing",
                (
                    SilentStream(
                        "GLOBAL_POSITION_INT", "SET_MESSAGE_INTERVAL", 50.0, "MAV_RESULT_ACCEPTED", False, True
                    ),
                ),
            ),
            "no GLOBAL_POSITION_INT (SET_MESSAGE_INTERVAL to 50 Hz: MAV_RESULT_ACCEPTED): PX4 sends none before it has "
            "a position; no GPS fix yet?",
        ),
    ],
)
def test_why_there_is_no_pose_in_words(why: NoPose, text: str) -> None:
    assert no_pose(why) == text


@every(
    "why, text",
    [
        (NoVehicle("link lost", "tcp: refused"), "no autopilot was found: tcp: refused"),
        (
            NoVehicle("silence"),
            "no byte came: is the autopilot powered, and sending MAVLink on this link?",
        ),
        (
            NoVehicle("no packets", bytes=150),
            "150 bytes came, but no MAVLink packet: is the baud rate right, and the port's protocol MAVLink?",
        ),
        (
            NoVehicle("no signature", "", 99, 3, (("unsigned", 1), ("forged", 2))),
            "3 packets came, but no autopilot's with the key: 1 unsigned, 2 forged",
        ),
        (
            NoVehicle("no heartbeat", "", 99, 4, (), (HeardSource("heartbeats of gcs", 255, 190, 4),)),
            "4 packets came, but no autopilot's heartbeat: heartbeats of gcs from 255/190 ×4",
        ),
        (
            NoVehicle("other vehicles", "", 99, 4, (), (HeardSource("heartbeats of quadrotor", 3, 1, 4),)),
            "4 packets came, but none of the wanted vehicle: heartbeats of quadrotor from 3/1 ×4; is its "
            "system id right?",
        ),
        (
            NoVehicle("no heartbeat", "", 99, 4),
            "4 packets came, all of other vehicles: is this one powered, and its system id right?",
        ),
    ],
)
def test_why_there_is_no_vehicle_in_words(why: NoVehicle, text: str) -> None:
    assert no_vehicle(why) == text
