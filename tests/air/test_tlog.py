from __future__ import annotations

import errno

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v10 import common as v1
from pymavlink.dialects.v20 import common as m

from labr_autonomy.record.tlog import Tlog, split_frames

NOW = 1795352904.25


def frame(seconds: int = 1) -> bytes:
    return bytes(m.MAVLink_system_time_message(seconds, 2).pack(m.MAVLink(None, 1, 1)))


def read_back(path):
    log = mavutil.mavlink_connection(str(path), dialect="common")
    try:
        return list(iter(lambda: log.recv_match(), None))
    finally:
        log.close()


def test_pymavlink_reads_the_frames_and_their_stamps(tmp_path):
    log = Tlog(tmp_path / "air.tlog")
    log.write(NOW, frame(1) + frame(2))
    log.write(NOW + 0.5, frame(3))
    log.close()
    read = read_back(log.path)
    assert [x.time_unix_usec for x in read] == [1, 2, 3]
    assert [x._timestamp for x in read] == pytest.approx([NOW, NOW, NOW + 0.5])
    assert (log.frames, log.dropped, log.fault) == (3, 0, None)


def test_a_signing_key_on_its_way_to_the_autopilot_is_not_logged(tmp_path):
    log = Tlog(tmp_path / "air.tlog")
    key = bytes(range(1, 33))
    setup = m.MAVLink_setup_signing_message(1, 1, key, 7).pack(m.MAVLink(None, 255, 190))
    log.write(NOW, frame(1) + setup + frame(2))
    log.close()
    assert [x.time_unix_usec for x in read_back(log.path)] == [1, 2]
    assert key not in log.path.read_bytes()
    assert (log.frames, log.dropped) == (2, 0)


def test_both_versions_signed_frames_and_dirt_are_told_apart():
    old = bytes(v1.MAVLink_system_time_message(1, 2).pack(v1.MAVLink(None, 1, 1)))
    signer = m.MAVLink(None, 1, 1)
    signer.signing.secret_key, signer.signing.sign_outgoing, signer.signing.timestamp = b"k" * 32, True, 1
    signed = bytes(m.MAVLink_system_time_message(1, 2).pack(signer))
    assert len(signed) == len(frame()) + 13
    assert list(split_frames(b"\x00\x01" + old + b"\x07" + signed + frame())) == [old, signed, frame()]


@pytest.mark.parametrize("cut", range(1, 12))
def test_a_frame_cut_short_is_left_out(cut):
    assert list(split_frames(frame() + frame()[:-cut])) == [frame()]


def test_closing_twice_is_harmless_and_ends_the_thread(tmp_path):
    log = Tlog(tmp_path / "air.tlog")
    log.close()
    log.close()
    assert not log._thread.is_alive()


def test_a_full_disk_ends_the_log_and_not_the_caller(tmp_path):
    class Full:
        def write(self, _data):
            raise OSError(errno.ENOSPC, "No space left on device")

        def close(self):
            pass

    log = Tlog(tmp_path / "air.tlog")
    log._file.close()
    log._file = Full()
    log.write(NOW, frame())
    log._flush()
    log.write(NOW, frame())
    log.close()
    assert "No space left" in log.fault
    assert log.dropped == 1
