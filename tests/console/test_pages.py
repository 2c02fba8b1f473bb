"""How pages are served: one message at a time, the newest next, nothing kept for those who do not look."""

from types import SimpleNamespace

import pytest

from labr_autonomy.console.access import Access
from labr_autonomy.console.feed import Seen
from labr_autonomy.console.pages import BURST, TRIES_MAX, Pages, Session
from labr_autonomy.console.requests import Kind


class FakeCockpit:
    def __init__(self):
        self.sent = []

    def run_method(self, name, message):
        self.sent.append((name, message))


class FakeFeed:
    def __init__(self):
        self.number, self.asked = 1, []

    def poll(self):
        self.number += 1

    def news(self, seen):
        if seen.state == self.number:
            return None
        seen.state = self.number
        return {"state": self.number}

    def ask(self, request):
        self.asked.append(request)

    def replay(self, command, value):
        self.asked.append((command, value))


class FakeClock:
    at_s = 100.0

    def now_s(self):
        return self.at_s


@pytest.fixture
def pages():
    made = Pages(FakeFeed(), Access("operator", "viewer", "127.0.0.1", 1), FakeClock())
    made.feed, made.clock = made._feed, made._clock
    return made


def session(pages, role="operator"):
    client = SimpleNamespace(id="c", has_socket_connection=True)
    made = Session("AB12", FakeCockpit(), client, role=role)
    pages._sessions["c"] = made
    return made


def said(**fields):
    return SimpleNamespace(args=fields)


def test_a_page_that_does_not_look_gets_one_message_and_no_more(pages):
    page = session(pages)
    for _ in range(1000):
        pages.feed.poll()
        pages._serve(page)
    assert len(page.cockpit.sent) == 1
    pages._saw(page, said(number=1))
    pages._serve(page)
    assert [m["state"] for _, m in page.cockpit.sent] == [2, pages.feed.number]  # the newest, not the next


def test_an_old_acknowledgement_does_not_count(pages):
    page = session(pages)
    pages._serve(page)
    pages._saw(page, said(number=7))
    pages.feed.poll()
    pages._serve(page)
    assert len(page.cockpit.sent) == 1


def test_who_has_no_role_or_no_connection_gets_nothing(pages):
    stranger = session(pages, role="")
    pages._serve(stranger)
    away = session(pages)
    away.client.has_socket_connection = False
    pages._serve(away)
    assert stranger.cockpit.sent == away.cockpit.sent == []


def test_after_a_break_a_page_begins_anew(pages):
    page = session(pages)
    pages._serve(page)
    pages._connected(page)
    assert page.seen == Seen()
    pages._serve(page)
    assert len(page.cockpit.sent) == 2


def test_tokens_are_tried_a_few_times_only(pages):
    page = session(pages, role="")
    for _ in range(TRIES_MAX):
        pages._hello(page, said(token="wrong"))
    pages._hello(page, said(token="operator"))
    assert page.role == ""
    other = session(pages, role="")
    pages._hello(other, said(token="operator"))
    assert other.role == "operator"
    assert other.cockpit.sent[-1] == ("welcome", {"role": "operator", "page": "AB12"})


def test_a_viewer_asks_nothing_and_replays_nothing(pages):
    viewer = session(pages, role="viewer")
    pages._ask(viewer, said(sequence=1, kind="abort", stamp_s=1.0))
    pages._replay(viewer, said(command="play", value=None))
    assert pages.feed.asked == []


@pytest.mark.parametrize("value", [10**400, "1", True, float("nan")])
def test_a_figure_that_is_none_moves_no_recording(pages, value):
    pages._replay(session(pages), said(command="seek", value=value))
    assert pages.feed.asked == [("seek", None)]


def test_no_two_open_pages_have_one_name(pages, monkeypatch):
    session(pages)
    drawn = iter(["ab12", "ab12", "cd34"])
    monkeypatch.setattr("secrets.token_hex", lambda _: next(drawn))
    assert pages._new_name() == "CD34"


def test_a_page_cannot_speak_for_another(pages):
    page = session(pages)
    pages._ask(page, said(sequence=1, kind="pause", stamp_s=1.0, page="FFFF"))
    assert [r.page for r in pages.feed.asked] == ["AB12"]


@pytest.mark.parametrize("args", [None, [], "abort", {"kind": "explode"}, {"sequence": "x", "kind": "abort"}])
def test_nonsense_is_not_passed_on(pages, args):
    pages._ask(session(pages), SimpleNamespace(args=args))
    assert pages.feed.asked == []


def test_asking_too_often_is_refused_but_never_an_abort(pages):
    page = session(pages)
    for i in range(100):
        pages._ask(page, said(sequence=i + 1, kind="pause", stamp_s=1.0))
    assert len(pages.feed.asked) == BURST
    for i in range(20):
        pages._ask(page, said(sequence=200 + i, kind="abort", stamp_s=1.0))
    assert sum(r.kind is Kind.ABORT for r in pages.feed.asked) == 20


def test_control_is_kept_for_pages_that_are_alive(pages):
    page = session(pages)
    page.heard_s = pages.clock.at_s
    for _ in range(4):
        pages._keep_control()
        pages.clock.at_s += 2.0
    # each says when the page was heard, so that silence is not counted from the last of them
    assert [(r.kind, r.stamp_s) for r in pages.feed.asked] == [(Kind.KEEP, 100.0)] * 3
