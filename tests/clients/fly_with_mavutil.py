"""A script as pymavlink's users write them: mavutil alone uploads, reads back and flies a mission.

    python fly_with_mavutil.py CONNECTION SYSID MISSION.waypoints

It prints one line of JSON: what was read back, and the modes and items on the way.
"""

import json
import math
import os
import sys
import time

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil, mavwp

PATIENCE_S = 120.0
PARAMS = {3: (b"WPNAV_SPEED", 450.0), 12: (b"MPC_XY_CRUISE", 4.5)}  # by MAV_AUTOPILOT


def main(connection, sysid, path):
    link = mavutil.mavlink_connection(connection, source_system=254)
    while True:
        if connection.startswith("udpout"):
            link.mav.heartbeat_send(6, 8, 0, 0, 4)
        beat = link.recv_match(type="HEARTBEAT", blocking=True, timeout=1)
        if beat is not None and beat.get_srcSystem() == sysid:
            break
    link.target_system, link.target_component = sysid, 1
    told = {"autopilot": beat.autopilot, "reached": [], "modes": [], "param": set_param(link, *PARAMS[beat.autopilot])}

    loader = mavwp.MAVWPLoader(target_system=sysid, target_component=1)
    loader.load(path)
    upload(link, loader)
    told["back"] = download(link)

    link.mav.command_long_send(sysid, 1, 511, 0, 245, 200_000, 0, 0, 0, 0, 0)  # EXTENDED_SYS_STATE
    link.mav.command_long_send(sysid, 1, 511, 0, 1, 200_000, 0, 0, 0, 0, 0)  # SYS_STATUS
    wait(link, "SYS_STATUS", lambda m: m.onboard_control_sensors_health & 0x10000000)
    if beat.autopilot == 3:
        wait(link, "GLOBAL_POSITION_INT", lambda m: m.lat, ask=33)
        link.set_mode("GUIDED")
        until_armed(link)
        link.mav.command_long_send(sysid, 1, 300, 0, 0, 0, 0, 0, 0, 0, 0)  # MISSION_START
    else:
        link.set_mode("MISSION")
        until_armed(link)

    flown, ended = False, time.monotonic() + PATIENCE_S
    while time.monotonic() < ended:
        m = link.recv_match(blocking=True, timeout=1)
        if m is None or m.get_srcSystem() != sysid:
            continue
        if m.get_type() == "MISSION_ITEM_REACHED" and m.seq not in told["reached"]:
            told["reached"].append(m.seq)
        elif m.get_type() == "EXTENDED_SYS_STATE":
            flown = flown or m.landed_state == 2
        elif m.get_type() == "HEARTBEAT":
            mode = mavutil.mode_string_v10(m)
            if mode not in told["modes"]:
                told["modes"].append(mode)
            if flown and not m.base_mode & 128:
                break
    else:
        sys.exit("it did not land")
    print(json.dumps(told))


def set_param(link, name, value):
    """A parameter as it is told after it was set."""
    link.mav.param_set_send(link.target_system, 1, name, value, 9)
    return wait(link, "PARAM_VALUE", lambda m: m.param_id == name.decode()).param_value


def upload(link, loader):
    """As every example does it."""
    link.mav.mission_count_send(link.target_system, 1, loader.count(), 0)
    while True:
        m = wait(link, ["MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"], lambda m: True)
        if m.get_type() == "MISSION_ACK":
            if m.type != 0:
                sys.exit(f"the mission was refused: {m.type}")
            return
        item = loader.wp(m.seq)
        link.mav.mission_item_int_send(
            link.target_system, 1, m.seq, item.frame, item.command, item.current, item.autocontinue,
            item.param1, item.param2, item.param3, item.param4, round(item.x * 1e7), round(item.y * 1e7), item.z, 0,
        )  # fmt: skip


def download(link):
    """Rows as the file has them."""
    link.mav.mission_request_list_send(link.target_system, 1, 0)
    count = wait(link, "MISSION_COUNT", lambda m: True).count
    rows = []
    for seq in range(count):
        link.mav.mission_request_int_send(link.target_system, 1, seq, 0)
        m = wait(link, "MISSION_ITEM_INT", lambda m, seq=seq: m.seq == seq)
        params = [0.0 if math.isnan(p) else p for p in (m.param1, m.param2, m.param3, m.param4)]
        rows.append([m.frame, m.command, *params, m.x / 1e7, m.y / 1e7, m.z])
    link.mav.mission_ack_send(link.target_system, 1, 0, 0)
    return rows


def until_armed(link):
    """Ask again until the vehicle is ready."""
    ended = time.monotonic() + PATIENCE_S
    while time.monotonic() < ended:
        link.arducopter_arm()
        ack = wait(link, "COMMAND_ACK", lambda m: m.command == 400)
        if ack.result == 0:
            return
        time.sleep(0.2)
    sys.exit("it did not arm")


def wait(link, kinds, fits, ask=None):
    """The next message of a kind, from the vehicle meant, that fits."""
    ended = time.monotonic() + PATIENCE_S
    while time.monotonic() < ended:
        if ask is not None:
            link.mav.command_long_send(link.target_system, 1, 512, 0, ask, 0, 0, 0, 0, 0, 0)
        m = link.recv_match(type=kinds, blocking=True, timeout=1)
        if m is not None and m.get_srcSystem() == link.target_system and fits(m):
            return m
    sys.exit(f"no {kinds}")


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), sys.argv[3])
