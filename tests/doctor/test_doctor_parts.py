"""What the doctor says of machine, ports, sensors, and what it hands on."""

import json
import os
import pty
import re
import socket
import zipfile
from types import SimpleNamespace

import numpy as np
import pytest

from firmware_bridge.dialect import labr_land as wire
from labr_autonomy.clock import SystemClock
from labr_autonomy.config import Links, RobotConfig
from labr_autonomy.doctor import controllers, machine, ports, sensors
from labr_autonomy.doctor.bundle import redacted, write_bundle
from labr_autonomy.doctor.finding import Finding, good, note, wrong
from labr_autonomy.errors import BadInput
from labr_autonomy.estimation.vio_message import VioSample, encode_vio
from labr_autonomy.ground.state import Telemetry, describe
from labr_autonomy.perception.frame_slot import FrameWriter

CLOCK = SystemClock()


def robot(**links):
    return RobotConfig(links=Links(**links))


def by_name(findings):
    return {f.name: f for f in findings}


# -- a line -----------------------------------------------------------------------------------------


def test_a_line_says_good_or_what_is_wrong_and_what_to_do():
    assert good("air", "identity", "PX4 1.18.0").line == "good   air      identity: PX4 1.18.0"
    assert wrong("vio", "poses", "0 Hz", "Start it.").line == "wrong  vio      poses: 0 Hz. Start it."
    assert note("air", "x", "y").line == "note   air      x: y"


# -- machine ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("have", "bound", "fits"),
    [
        ("4.1.0", ">=4.1,<5", True),
        ("5.0.0", ">=4.1,<5", False),
        ("4.0.5", ">=4.1,<5", False),
        ("2.13.0+cpu", "==2.13.0", True),
        ("3.8", "!=3.8.0", False),
        ("2.4.50", ">=2.4.50", True),
        ("2.4.5", ">=2.4.50", False),
    ],
)
def test_versions_are_compared_by_number(have, bound, fits):
    assert machine._fits(have, bound) is fits


def test_a_package_of_another_version_is_named_with_its_remedy(monkeypatch):
    monkeypatch.setattr(machine.metadata, "requires", lambda _: ["mavsdk<5,>=4.1", 'ray>=2; extra == "x"'])
    monkeypatch.setattr(machine.metadata, "version", lambda name: "3.15.0" if name == "mavsdk" else "9.9")
    found = by_name(machine._versions())
    assert found["mavsdk"].state == "wrong"
    assert "3.15.0 is installed, <5,>=4.1 is wanted" in found["mavsdk"].text
    assert found["mavsdk"].do == "pip install 'mavsdk<5,>=4.1'"
    assert found["numpy"].state == "good"


def test_little_memory_is_wrong(tmp_path):
    meminfo = tmp_path / "meminfo"
    meminfo.write_text("MemTotal: 8000000 kB\nMemAvailable:  500000 kB\n")
    assert machine._memory(meminfo).state == "wrong"
    meminfo.write_text("MemAvailable:  5000000 kB\n")
    assert machine._memory(meminfo).state == "good"
    assert machine._memory(tmp_path / "none").state == "note"


def test_a_full_disk_is_wrong_and_a_folder_that_is_not_there_yet_is_not(tmp_path, monkeypatch):
    assert machine._disk(tmp_path / "runs" / "deep").state == "good"
    usage = type("Usage", (), {"free": 1 << 20})
    monkeypatch.setattr(machine.shutil, "disk_usage", lambda _: usage)
    assert machine._disk(tmp_path).state == "wrong"


def test_weights_that_were_changed_are_wrong(tmp_path):
    config = RobotConfig()
    assert machine._weights(config).state == "good"
    network = config.network.model_copy(update={"weights": tmp_path})
    assert machine._weights(config.model_copy(update={"network": network})).state == "wrong"


# -- ports ------------------------------------------------------------------------------------------


@pytest.fixture
def by_id(tmp_path):
    """udev's folder with a Pixhawk and a land controller, which are pseudo-terminals."""
    folder, opened = tmp_path / "by-id", []
    folder.mkdir()
    for name in ("usb-Holybro_Pixhawk6C_0-if00", "usb-LABR_land_controller"):
        master, slave = pty.openpty()
        opened += [master, slave]
        (folder / name).symlink_to(os.ttyname(slave))
    yield folder
    for fd in opened:
        os.close(fd)


def test_devices_that_are_there_are_good(by_id):
    air, ground = by_id / "usb-Holybro_Pixhawk6C_0-if00", by_id / "usb-LABR_land_controller"
    found = by_name(ports.examine_ports(robot(air=f"serial://{air}:921600", ground=str(ground)), by_id))
    assert [found[n].state for n in ("found", "air", "ground")] == ["good"] * 3
    assert "usb-LABR_land_controller" in found["found"].text


def test_what_is_meant_is_named_when_the_device_is_not_there(by_id):
    found = by_name(ports.examine_ports(robot(air="serial:///dev/nope:1", ground="/dev/neither"), by_id))
    assert found["air"].do == f"Set links.air to {by_id / 'usb-Holybro_Pixhawk6C_0-if00'}."
    assert found["ground"].do == f"Set links.ground to {by_id / 'usb-LABR_land_controller'}."
    assert {found["air"].state, found["ground"].state} == {"wrong"}


def test_a_name_that_may_change_is_noted(by_id):
    device = (by_id / "usb-LABR_land_controller").resolve()
    found = by_name(ports.examine_ports(robot(air="udpin://x:1", ground=str(device)), by_id))
    assert found["ground"].state == "note"
    assert str(by_id / "usb-LABR_land_controller") in found["ground"].do
    assert found["air"].state == "good"


def test_a_device_that_this_user_may_not_open_names_the_group(by_id, monkeypatch):
    monkeypatch.setattr(ports.os, "access", lambda *_: False)
    ground = by_id / "usb-LABR_land_controller"
    found = by_name(ports.examine_ports(robot(air="udpin://x:1", ground=str(ground)), by_id))
    assert found["ground"].state == "wrong"
    assert re.search(r"Add the user to the group \w+", found["ground"].do)


def test_a_file_is_no_device(tmp_path):
    (tmp_path / "tty").write_text("")
    found = by_name(
        ports.examine_ports(robot(air="udpin://x:1", ground=str(tmp_path / "tty")), tmp_path / "no")
    )
    assert "no serial device" in found["ground"].text
    assert found["found"].state == "note"


# -- sensors ----------------------------------------------------------------------------------------


def test_a_camera_that_is_not_there_is_wrong(monkeypatch):
    monkeypatch.setattr(sensors, "FIND_S", 0.05)
    (finding,) = sensors.examine_camera(robot(depth="labr_doctor_nobody"))
    assert (finding.area, finding.state) == ("camera", "wrong")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("late_s", "empty", "wrongs"),
    [(0.0, False, set()), (0.5, False, {"clock"}), (-0.5, False, {"clock"}), (0.0, True, {"view"})],
)
def test_a_camera_is_judged_by_rate_stamps_and_view(late_s, empty, wrongs, monkeypatch):
    config = robot(depth=f"labr_doctor_{os.getpid()}")
    writer = FrameWriter(config.links.depth, config.camera.intrinsics)
    monkeypatch.setattr(sensors, "LOOK_S", 0.3)
    depth = np.full((config.camera.height, config.camera.width), 0.0 if empty else 2.0, np.float32)
    written = []

    def publish(_duration_s):
        written.append(writer.write(CLOCK.now_s() - late_s, depth))

    monkeypatch.setattr(sensors, "pause_s", publish)
    try:
        publish(0.0)
        found = by_name(sensors.examine_camera(config))
    finally:
        writer.close()
    assert {name for name, f in found.items() if f.state == "wrong"} == wrongs
    assert found["intrinsics"].state == "good"


@pytest.mark.slow
@pytest.mark.parametrize(("late_s", "names"), [(0.03, set()), (0.6, {"clock"}), (-10.0, {"poses"})])
async def test_poses_are_judged_by_rate_and_stamps(late_s, names, monkeypatch):
    monkeypatch.setattr(sensors, "LOOK_S", 0.5)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    config, out = robot(vio=f"udp://127.0.0.1:{port}"), socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    class Sending(SystemClock):
        async def sleep_until(self, due_s):
            k = 0
            while self.now_s() < due_s:
                sample = VioSample(
                    self.now_s() - late_s,
                    np.zeros(3),
                    np.array([1.0, 0, 0, 0]),
                    np.zeros(3),
                    np.eye(6) * 1e-4,
                )
                out.sendto(encode_vio(sample, k & 0xFF), ("127.0.0.1", port))
                k += 1
                await SystemClock.sleep_until(self, self.now_s() + 0.01)

    monkeypatch.setattr(sensors, "SystemClock", Sending)
    found = by_name(await sensors.examine_vio(config))
    out.close()
    assert {name for name, f in found.items() if f.state == "wrong"} == names
    if late_s < 0.0:
        assert "stamp lies in the future" in found["poses"].text


# -- land controller --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mode", "faults", "state", "words"),
    [
        (wire.LAND_MODE_IDLE, 0, "good", "idle, battery 18.5 V"),
        (wire.LAND_MODE_ESTOP, wire.LAND_FAULT_ESTOP, "wrong", "emergency stop"),
        (wire.LAND_MODE_IDLE, wire.LAND_FAULT_DRIVER, "wrong", "motor driver fault"),
        (wire.LAND_MODE_IDLE, wire.LAND_FAULT_BATTERY_LOW, "wrong", "battery low"),
    ],
)
def test_a_stopped_or_faulty_land_controller_is_not_called_good(mode, faults, state, words):
    names = wire.MAVLink_land_state_message.fieldnames
    given = {"mode": mode, "faults": faults, "battery_mv": 18_500}
    message = wire.MAVLink_land_state_message(**{name: given.get(name, 0) for name in names})
    channel = SimpleNamespace(state=describe(Telemetry(1.0, 1.0, message), True, "", 1.01))
    found = controllers._land_state(channel)
    assert (found.state, bool(found.do)) == (state, state == "wrong")
    assert words in found.text


# -- bundle -----------------------------------------------------------------------------------------

KEY = "9f" * 32


@pytest.mark.parametrize(
    "secret",
    [
        f"signing_key: {KEY}",
        'token = "hunter2hunter2"',
        "PASSWORD=hunter2hunter2",
        '{"api_key": "hunter2hunter2"}',
        "tcp://me:hunter2hunter2@10.0.0.1:5760",
        f"key was {KEY}",
    ],
)
def test_secrets_are_blackened(secret):
    text = redacted(f"before\n{secret}\nafter")
    assert "hunter2" not in text
    assert KEY not in text
    assert text.startswith("before\n")
    assert text.endswith("after")


def test_the_words_around_stay_readable():
    kept = "the autopilot refused to arm: denied; 3 tokens of 4, dialect 4151627A"
    assert redacted(kept) == kept


def test_the_archive_holds_findings_settings_and_the_last_runs_words_and_nothing_secret(
    tmp_path, monkeypatch
):
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setattr("labr_autonomy.doctor.bundle._user", lambda: "wilma")
    runs = tmp_path / "runs"
    for name in ("20260101-000000-old", "20260102-000000-new"):
        (runs / name).mkdir(parents=True)
        (runs / name / "executive.log").write_text(
            f"{name} of wilma in {tmp_path / 'home'}/x token: abc123\n"
        )
        (runs / name / "air.tlog").write_bytes(b"\0" * 100)
        (runs / name / "signing.key").write_text(KEY)
    path = tmp_path / "report.zip"
    names = write_bundle(path, [wrong("vio", "poses", "0 Hz", "Start it.")], RobotConfig(), runs)
    with zipfile.ZipFile(path) as archive:
        assert archive.namelist() == names
        texts = {name: archive.read(name).decode() for name in names}
    assert set(names) == {"doctor.json", "doctor.txt", "robot.json", "machine.json", "run/executive.log"}
    assert json.loads(texts["doctor.json"])["findings"][0]["text"] == "0 Hz"
    assert json.loads(texts["robot.json"])["name"] == "LABR"
    assert texts["run/executive.log"] == "20260102-000000-new of [user] in ~/x token: [removed]\n"
    assert KEY not in "".join(texts.values())


def test_an_archive_that_cannot_be_written_is_a_sentence(tmp_path):
    with pytest.raises(BadInput, match="cannot be written"):
        write_bundle(tmp_path / "no" / "x.zip", [Finding("a", "b", "good", "c")], RobotConfig(), tmp_path)
