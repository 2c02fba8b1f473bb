import pytest

from labr_autonomy.console.access import Access, Gate, make_access
from labr_autonomy.errors import BadInput

TOKEN = "k3J9-x_2mQ7vB1nR5tY8wZ"


def access(host="127.0.0.1"):
    return Access("operator-token-operator", "viewer-token-viewer-view", host, 8460)


def scope(kind="http", method="GET", path="/", **headers):
    raw = [(k.replace("_", "-").encode(), v.encode()) for k, v in headers.items()]
    return {"type": kind, "method": method, "path": path, "headers": raw}


def refusal(**arguments):
    return Gate(lambda *_: None, access()).refusal(scope(**arguments))


def test_a_token_opens_what_it_is_for_and_nothing_else():
    a = access()
    assert a.role("operator-token-operator") == "operator"
    assert a.role("viewer-token-viewer-view") == "viewer"
    for wrong in ("", "operator-token-operato", "OPERATOR-token-operator", "é", "viewer"):
        assert a.role(wrong) == ""


def test_new_tokens_have_128_bits_and_differ():
    first, second = (make_access("127.0.0.1", 1, None) for _ in range(2))
    assert len({first.operator, first.viewer, second.operator, second.viewer}) == 4
    assert len(first.operator) >= 22
    assert first.url(first.operator) == f"http://127.0.0.1:1/#t={first.operator}"


@pytest.mark.parametrize("host", ["127.0.0.1:8460", "localhost:8460"])
def test_own_names_are_answered(host):
    assert refusal(host=host) == ""
    assert refusal(host=host, origin=f"http://{host}") == ""
    assert refusal(kind="websocket", host=host, origin=f"http://{host}") == ""


@pytest.mark.parametrize(
    "arguments",
    [
        {"host": "evil.example:8460"},
        {"host": "127.0.0.1:8461"},
        {"host": "127.0.0.1"},
        {"host": "127.0.0.1.evil.example:8460"},
        {},
        {"host": "localhost:8460", "origin": "http://evil.example"},
        {"host": "localhost:8460", "origin": "null"},
        {"host": "localhost:8460", "origin": "https://localhost:8460"},
        {"kind": "websocket", "host": "localhost:8460"},
        {"kind": "websocket", "host": "localhost:8460", "origin": "http://localhost:8461"},
        {"host": "localhost:8460", "method": "POST"},
        {"host": "localhost:8460", "path": "/_nicegui_ws/socket.io/"},
    ],
)
def test_everything_else_is_refused(arguments):
    assert refusal(**arguments)


def test_another_address_needs_a_token_file():
    with pytest.raises(BadInput, match="needs a token that you keep"):
        make_access("192.168.1.5", 8460, None)
    with pytest.raises(BadInput, match="every network"):
        make_access("0.0.0.0", 8460, None)
    with pytest.raises(BadInput, match="no IP address"):
        make_access("robot.local", 8460, None)


def test_a_token_file_is_taken_and_the_viewers_token_follows_from_it(tmp_path):
    path = tmp_path / "token"
    path.write_text(TOKEN + "\n")
    path.chmod(0o600)
    a, b = (make_access("192.168.1.5", 8460, path) for _ in range(2))
    assert a.operator == TOKEN
    assert a.viewer == b.viewer != TOKEN
    assert a.hosts == {"192.168.1.5:8460"}


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660])
def test_a_token_file_that_others_can_read_is_refused(tmp_path, mode):
    path = tmp_path / "token"
    path.write_text(TOKEN)
    path.chmod(mode)
    with pytest.raises(BadInput, match="chmod 600"):
        make_access("127.0.0.1", 8460, path)


@pytest.mark.parametrize("token", ["", "short", "with space in it, and long enough", "é" * 30])
def test_a_weak_token_is_refused(tmp_path, token):
    path = tmp_path / "token"
    path.write_text(token)
    path.chmod(0o600)
    with pytest.raises(BadInput, match="at least 22"):
        make_access("127.0.0.1", 8460, path)
    with pytest.raises(BadInput, match="cannot be read"):
        make_access("127.0.0.1", 8460, tmp_path / "none")
