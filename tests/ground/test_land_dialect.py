from __future__ import annotations

import pytest

from firmware_bridge.dialect import generate, labr_land
from labr_autonomy.errors import BadInput


def test_committed_file_is_what_the_xml_generates(tmp_path):
    fresh = generate.generate(tmp_path)
    committed = generate.HERE / "labr_land.py"
    assert fresh.read_text() == committed.read_text(), "run python -m firmware_bridge.dialect.generate"


def edited(tmp_path, old: str, new: str):
    text = generate.XML.read_text()
    assert old in text
    path = tmp_path / "labr_land.xml"
    path.write_text(text.replace(old, new))
    return path


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('type="int16_t" name="v" units="mm/s">forward', 'type="int32_t" name="v" units="mm/s">forward'),
        ('name="deadline_ms"', 'name="until_ms"'),
        ('value="2" name="LAND_FLAG_AIR_LOCK"', 'value="4" name="LAND_FLAG_AIR_LOCK"'),
        ('id="54012"', 'id="54013"'),
    ],
)
def test_hash_sees_a_change_of_meaning(tmp_path, old, new):
    assert generate.dialect_hash(edited(tmp_path, old, new)) != labr_land.DIALECT_HASH


def test_hash_does_not_see_words_and_comments(tmp_path):
    path = edited(tmp_path, "the computer means to drive", "other words <!-- and a remark -->")
    assert generate.dialect_hash(path) == labr_land.DIALECT_HASH


def test_xml_without_protocol_version_is_refused(tmp_path):
    path = edited(tmp_path, "LAND_PROTOCOL_VERSION", "SOMETHING")
    with pytest.raises(BadInput, match="LAND_PROTOCOL_VERSION"):
        generate.protocol_version(path)


def test_broken_xml_is_refused_with_a_sentence(tmp_path):
    path = edited(tmp_path, 'id="54001"', 'id="54000"')
    with pytest.raises(BadInput, match=r"mavgen refused labr_land\.xml"):
        generate.generate(tmp_path, path)


@pytest.mark.parametrize(
    ("message", "number", "crc_extra"),
    [
        (labr_land.MAVLink_land_hello_message, 54000, 92),
        (labr_land.MAVLink_land_identity_message, 54001, 113),
    ],
)
def test_the_two_messages_of_the_handshake_never_change(message, number, crc_extra):
    assert (message.id, message.crc_extra) == (number, crc_extra)


def test_frames_fit_a_small_controller():
    assert max(m.unpacker.size for m in labr_land.mavlink_map.values()) <= 64
    assert labr_land.MAVLink_land_velocity_message.unpacker.size <= 16
