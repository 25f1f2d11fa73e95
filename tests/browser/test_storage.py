"""A full disk, a read-only one, a broken database: the display goes on and says so.

The tests need mount namespaces, as root or through user namespaces, and fail without them. The one with a frozen disk
needs root.
"""

import contextlib
import json
import os
import socket
import sqlite3
import subprocess
import sys
import urllib.error

import pytest
from playwright.sync_api import expect

from operating import expect_standing, log_in, stage, step
from sizes import SIZES, faults
from vehicle import CONFIG, OPERATOR, TELLTALE, Client, Server, Vehicle, own_domain, serving, until

DEVELOPER = ("dora", "a long password")
IS_ROOT = os.geteuid() == 0
# A probe every five seconds, and a margin.
NOTICE_S = 12
FILL = "dd if=/dev/zero of=fill bs=4k 2>/dev/null || true; dd if=/dev/zero of=rest bs=1k 2>/dev/null || true"


class Mounted(Server):
    """A server whose data folder is a small file system in a mount namespace of its own."""

    def start(self):
        data = self.folder / "data"
        data.mkdir()
        self.data = data
        serve = [TELLTALE, "serve", "--config", CONFIG, "--data", data, "--interface", "127.0.0.1"]
        serve += ["--listen", f"127.0.0.1:{self.port}", "--domain", self.domain]
        secret, password = (f"{it}\\n{it}\\n" for it in (OPERATOR[1], DEVELOPER[1]))
        script = f"""
            set -e
            mount -t tmpfs -o size=16m,mode=0700 tmpfs {data}
            printf '{secret}' | {TELLTALE} user add {OPERATOR[0]} --role operator --data {data}
            printf '{password}' | {TELLTALE} user add {DEVELOPER[0]} --role developer --data {data}
            exec {' '.join(map(str, serve))}
        """
        self.words = serve
        words = ["unshare", "--mount", "--propagation", "private", *([] if IS_ROOT else ["--map-root-user"])]
        return self.run([*words, "sh", "-c", script])

    def enter(self, *words):
        user = [] if IS_ROOT else ["--user", "--preserve-credentials"]
        return ["nsenter", *user, "--mount", "--target", str(self.process.pid), *map(str, words)]

    def start_again(self, meanwhile="true"):
        """After a `kill -9`, on the same file system: something stays in its namespace and runs a script there meanwhile."""
        stays = subprocess.Popen(self.enter("sleep", "600"))
        namespace = lambda pid: os.readlink(f"/proc/{pid}/ns/mnt")
        until(lambda: namespace(stays.pid) == namespace(self.process.pid), 5, "the namespace is entered")
        self.kill()
        self.process = stays
        try:
            self.inside(meanwhile)
            self.run(self.enter(*self.words))
        finally:
            stays.kill()
            stays.wait(timeout=10)

    def inside(self, script):
        """Runs a script where the server sees its data folder."""
        words = self.enter("sh", "-ec", f"cd {self.data}\n{script}")
        return subprocess.run(words, text=True, capture_output=True, timeout=60, check=True).stdout


@pytest.fixture
def mounted(tmp_path):
    server = Mounted(tmp_path, own_domain())
    server.start()
    yield server
    assert server.stop() == 0


def storage(client, node="telltale/storage"):
    """The message of the WARNING, if there is one."""
    snapshot = client.snapshot()
    groups = [group for group in snapshot["groups"] if group["id"] == "telltale"]
    modules = [module for group in groups for module in group["modules"] if module["id"] == node]
    found = [module for module in modules if module["state"] == "warning"]
    assert all(module["state"] in ("ok", "warning") for module in modules), modules
    return found[0]["message"] if found else None


def mark(client):
    """The number of the incident, if the moment is marked."""
    try:
        return json.loads(client.post("/api/v1/mark"))["incident"]
    except urllib.error.HTTPError as refused:
        assert refused.code == 503, refused
        return None


def goes_on(client):
    """The display lives: what is published grows older and is replaced."""
    first = client.snapshot()["at"]
    until(lambda: client.snapshot()["at"] > first, 5, "the snapshots go on")


def test_a_full_disk_is_a_warning_and_the_display_goes_on(mounted):
    client = Client(mounted, *OPERATOR)
    assert storage(client) is None
    mounted.inside("dd if=/dev/zero of=fill bs=64k 2>/dev/null || true; dd if=/dev/zero of=rest bs=1k 2>/dev/null || true")
    message = until(lambda: storage(client), NOTICE_S, "a warning")
    assert "full" in message, message
    goes_on(client)
    # A mark that the disk does not take is not promised.
    recording = lambda: storage(client, "telltale/recording")
    until(recording, 60, "no incident can be recorded")
    assert mark(client) is None
    mounted.inside("rm fill rest")
    until(lambda: storage(client) is None, NOTICE_S, "the warning ends")
    until(lambda: recording() is None, 60, "the warning ends")
    assert until(lambda: mark(client), NOTICE_S, "incidents are recorded again")
    Client(mounted, *OPERATOR)
    assert mounted.inside(f"{TELLTALE} audit verify --data .").startswith("ok")


@pytest.mark.parametrize("disk", [FILL, "mount --bind $PWD $PWD; mount -o remount,bind,ro $PWD"], ids=["full", "read-only"])
def test_a_start_on_a_disk_without_room_for_the_index_of_the_log_knows_what_was_written_last(mounted, disk):
    client = Client(mounted, *OPERATOR)
    # A power cut may leave the log without its index.
    mounted.start_again(f"test -s telltale.db-wal; rm telltale.db-shm; {disk}")
    # The session stands in the log alone.
    assert client.snapshot()["stage"] == "localizing"
    assert "telltale.db" in until(lambda: storage(client), NOTICE_S, "a warning")
    goes_on(client)


def no_clearance(client):
    """There is none, and the reason is said."""
    with pytest.raises(urllib.error.HTTPError) as refused:
        client.post("/vehicle/clearance", version=client.snapshot()["seq"])
    said = refused.value.read().decode()
    assert refused.value.code == 409 and "Nothing can be recorded" in said, (refused.value.code, said)


def recording_of(developer, number):
    """The recording of an incident, as the list has it."""
    listed = json.load(developer.opener.open(f"{developer.server.url}/api/v1/incidents", timeout=10))
    return next((it["recording"] for it in listed if it["id"] == number), {})


def recorded(client, server):
    """Waits until an incident that is marked now is finished, verifies it, and returns its story."""
    number = until(lambda: mark(client), NOTICE_S, "incidents are recorded again")
    developer = Client(server, *DEVELOPER)
    until(lambda: recording_of(developer, number).get("finished"), 60, lambda: recording_of(developer, number))
    told = server.inside(f"{TELLTALE} incident verify {number} --data .")
    assert f"ok    incident {number}:" in told, told
    one = json.load(developer.opener.open(f"{server.url}/api/v1/incidents/{number}", timeout=10))
    return one["story"]["moments"]


def refusals(moments):
    """The reasons of clearances that an operator did not get, as an incident tells them."""
    return [it["why"] for it in moments if it["kind"] == "refused" and it["action"] == "clearance" and it["by"] == OPERATOR[0]]


def recording_off(client):
    """The message of the WARNING, with which a clearance is refused too."""
    message = storage(client, "telltale/recording")
    return message if message and message.startswith("recording off: ") else None


def test_recordings_on_a_read_only_disk_are_a_warning_until_they_are_taken_again(mounted):
    client = Client(mounted, *OPERATOR)
    folder = mounted.data / "incidents"
    mounted.inside(f"mount --bind {folder} {folder}; mount -o remount,bind,ro {folder}")
    until(lambda: mark(client) is None, NOTICE_S, "no incident can be recorded")
    message = until(lambda: recording_off(client), NOTICE_S, "a warning")
    assert "Read-only" in message, message
    no_clearance(client)
    goes_on(client)
    mounted.inside(f"umount {folder}")
    until(lambda: recording_off(client) is None, NOTICE_S, "the warning ends")
    told = refusals(recorded(client, mounted))
    assert len(told) == 1 and "Nothing can be recorded" in told[0], told


def test_a_mark_that_a_full_disk_does_not_take_is_refused_and_leaves_nothing(mounted):
    client = Client(mounted, *OPERATOR)
    assert recording_off(client) is None
    folder = mounted.data / "incidents"
    mounted.inside(f"mount -t tmpfs -o size=8m,mode=0700 tmpfs {folder}; cd {folder}; {FILL}")
    # Nothing was written since: the mark itself is the first that fails.
    assert mark(client) is None
    message = until(lambda: recording_off(client), 2, "a warning at once")
    assert "the disk is full" in message, message
    no_clearance(client)
    goes_on(client)
    assert mounted.inside("ls incidents").split() == ["fill", "rest"]
    assert mounted.inside(f"{TELLTALE} incident verify --data .").startswith("ok")
    mounted.inside("rm incidents/fill incidents/rest")
    until(lambda: recording_off(client) is None, NOTICE_S, "the warning ends")
    recorded(client, mounted)
    mounted.inside(f"umount -l {folder}")


def test_an_incident_that_a_full_disk_cuts_off_is_whole_soon_after_there_is_room(mounted):
    client, developer = Client(mounted, *OPERATOR), Client(mounted, *DEVELOPER)
    folder = mounted.data / "incidents"
    mounted.inside(f"mount -t tmpfs -o size=8m,mode=0700 tmpfs {folder}")
    number = mark(client)
    mounted.inside(f"cd incidents; {FILL}")
    until(lambda: recording_of(developer, number).get("interrupted"), 60, lambda: recording_of(developer, number))
    mounted.inside("rm incidents/fill incidents/rest")
    until(lambda: recording_of(developer, number).get("finished"), 30, lambda: recording_of(developer, number))
    assert f"incident {number}:" in mounted.inside(f"{TELLTALE} incident verify {number} --data .")
    mounted.inside(f"umount -l {folder}")


@pytest.fixture
def freezing(mounted, tmp_path):
    """Freezes and thaws the file system of the recordings, which is one of its own."""
    folder = mounted.data / "incidents"
    image = tmp_path / "recordings.img"
    with open(image, "wb") as file:
        file.truncate(64 << 20)
    subprocess.run(["mkfs.ext4", "-q", image], check=True)
    mounted.inside(f"mount -o loop {image} {folder}")
    yield lambda freeze: mounted.inside(f"fsfreeze {'-f' if freeze else '-u'} {folder}")
    # Nothing that waits for a frozen disk can be ended.
    subprocess.run(mounted.enter("fsfreeze", "-u", folder), capture_output=True)


def test_recordings_on_a_disk_that_hangs_are_a_warning_until_it_answers(mounted, freezing):
    client = Client(mounted, *OPERATOR)
    freezing(True)
    mark(client)
    message = until(lambda: recording_off(client), NOTICE_S, "a warning")
    assert "has not answered for 3 s" in message, message
    goes_on(client)
    assert mark(client) is None
    no_clearance(client)
    freezing(False)
    until(lambda: recording_off(client) is None, NOTICE_S, "the warning ends")
    recorded(client, mounted)


def test_a_disk_that_becomes_read_only_is_a_warning_and_the_display_goes_on(mounted):
    client = Client(mounted, *OPERATOR)
    mounted.inside(f"mount --bind {mounted.data} {mounted.data}; mount -o remount,bind,ro {mounted.data}")
    message = until(lambda: storage(client), NOTICE_S, "a warning")
    assert "read-only" in message, message
    assert until(lambda: mark(client) is None, NOTICE_S, "no incident can be recorded")
    no_clearance(client)
    goes_on(client)
    # From outside: nobody can unmount the folder in which they are.
    mounted.inside(f"cd /; umount {mounted.data}")
    until(lambda: storage(client) is None, NOTICE_S, "the warning ends")


def hang(server, client, refused_path="/vehicle/clearance/withdraw"):
    """The head of the log is written into a pipe that nobody reads."""
    pipe = f"audit.head.{server.process.pid}"
    until(lambda: "made" in server.inside(f"mkfifo {pipe} 2>/dev/null && echo made || true"), 5, "a pipe")
    with pytest.raises(urllib.error.HTTPError) as refused:
        client.post(refused_path, version=client.snapshot()["seq"])
    assert refused.value.code == 409, "it is not possible now, and that is recorded"
    return pipe


def let_go(server, pipe):
    """Reads what the server writes, to its end."""
    server.inside(f"exec 3<{pipe}; rm {pipe}; cat <&3 >/dev/null")


def test_a_disk_that_hangs_is_a_warning_and_the_display_goes_on(mounted):
    client = Client(mounted, *OPERATOR)
    pipe = hang(mounted, client)
    message = until(lambda: storage(client), NOTICE_S, "a warning")
    assert "has not answered" in message, message
    goes_on(client)
    with pytest.raises(urllib.error.HTTPError) as refused:
        client.post("/vehicle/localize", version=client.snapshot()["seq"], stop="depot")
    assert refused.value.code == 503 and "nothing was changed" in refused.value.read().decode()
    let_go(mounted, pipe)
    until(lambda: storage(client) is None, NOTICE_S, "the warning ends")
    assert client.snapshot()["stage"] == "localizing"
    log = until(lambda: written(mounted, "localize"), 5, "what was not done is on the record")
    assert log.startswith("localize") and "depot refused: " in log, log
    assert mounted.inside(f"{TELLTALE} audit verify --data .").startswith("ok")


@pytest.mark.timed
def test_a_disk_that_hangs_does_not_hold_up_the_end(mounted):
    hang(mounted, Client(mounted, *OPERATOR))
    assert mounted.stop() == 0
    # Each step gets its turn, and says what it could not write.
    log = mounted.read_log()
    for said in ["the last change of the vehicle is not stored", "the end is not recorded", "the disk does not answer: what it was given last"]:
        assert said in log, log
    assert "the end takes too long" not in log, log


def test_a_request_without_an_end_takes_no_time_of_what_is_to_be_written(tmp_path):
    with serving(tmp_path) as server, socket.create_connection(("127.0.0.1", server.port)) as asking:
        asking.sendall(b"GET /login HTTP/1.1\r\nHost: ")
        until(server.answers, 5, "it has read so far")
        assert server.stop() == 0
        log = sqlite3.connect(f"file:{tmp_path / 'telltale.db'}?mode=ro", uri=True)
        assert log.execute("SELECT action FROM audit ORDER BY number DESC LIMIT 1").fetchone() == ("end",)
        assert "the end takes too long" not in server.read_log()


def written(server, action):
    """The records of this action, if there are any."""
    script = f"""
import sqlite3
log = sqlite3.connect("file:telltale.db?mode=ro", uri=True).execute("SELECT action, target, outcome FROM audit")
print(*(" ".join(record) for record in log if record[0] == {action!r}))
"""
    return server.inside(f"{sys.executable} - <<'END'\n{script}\nEND").strip()


@pytest.fixture
def driving(mounted, page, tmp_path):
    """The operator's page of a vehicle that drives."""
    with contextlib.closing(Vehicle(mounted.domain, tmp_path)) as vehicle:
        log_in(page, mounted)
        expect_standing(page)
        vehicle.drive(True)
        stage(page, "active")
        yield page


NOT_RECORDED = {
    "en": "The vehicle is asked to stop. The disk is full or broken, so that is not recorded yet. Call the control room.",
    "de": "Das Fahrzeug soll anhalten. Der Speicher ist voll oder defekt, daher ist das noch nicht aufgezeichnet. Leitstelle rufen.",
}


@pytest.mark.parametrize("lang", NOT_RECORDED)
def test_a_stop_that_is_not_recorded_is_requested_and_says_so(mounted, driving, trouble, lang):
    page, stop, notice = driving, step(driving, "stop"), driving.locator("#notice li")
    if lang == "de":
        page.locator("[data-tool=language]").evaluate("button => button.click()")
        expect(stop).to_contain_text("Fahrzeug anhalten")
    pipe = hang(mounted, Client(mounted, *OPERATOR), "/vehicle/clearance")
    stop.click()
    expect(page.locator("#countermeasure[data-request=maneuver_stop]")).to_be_visible()
    expect(notice).to_have_text(NOT_RECORDED[lang])
    expect(stop).to_have_attribute("aria-pressed", "true")
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        expect(notice).to_be_visible()
        assert not faults(page), f"{width}x{height}: {faults(page)}"
    let_go(mounted, pipe)
    until(lambda: written(mounted, "stop"), 5, "it is recorded")
    trouble.expect("503")


@pytest.mark.parametrize("wrong", ["full", "read-only"])
def test_a_restart_on_a_disk_that_takes_nothing_shows_what_it_showed(mounted, wrong):
    client = Client(mounted, *OPERATOR)
    if wrong == "full":
        mounted.inside(FILL)
    else:
        mounted.inside(f"mount --bind {mounted.data} {mounted.data}; mount -o remount,bind,ro {mounted.data}")
    mounted.start_again()
    message = until(lambda: storage(client), NOTICE_S, "a warning")
    assert wrong in message or wrong.replace("-", "") in message, message
    assert client.snapshot()["stage"] == "localizing"
    goes_on(client)
    with pytest.raises(urllib.error.HTTPError) as refused:
        client.post("/logout")
    assert refused.value.code == 503 and "disk" in refused.value.read().decode()
    assert client.snapshot()["stage"] == "localizing"
    mounted.inside("rm fill rest" if wrong == "full" else f"mount -o remount,bind,rw {mounted.data}")
    until(lambda: storage(client) is None, NOTICE_S, "the warning ends")
    Client(mounted, *OPERATOR)
    assert mounted.inside(f"{TELLTALE} audit verify --data .").startswith("ok")


def test_a_database_that_is_overwritten_or_removed_is_a_warning_and_the_display_goes_on(mounted):
    client = Client(mounted, *OPERATOR)
    # Only what never changes is put back: the server goes on writing the rest meanwhile.
    into_start = "dd of=telltale.db bs=16 count=1 conv=notrunc 2>/dev/null"
    mounted.inside(f"head -c 16 telltale.db > kept; {into_start} if=/dev/urandom")
    message = until(lambda: storage(client), NOTICE_S, "a warning")
    assert "overwritten" in message, message
    goes_on(client)
    mounted.inside(f"{into_start} if=kept")
    until(lambda: storage(client) is None, NOTICE_S, lambda: f"the warning ends: {storage(client)}")
    mounted.inside("mv telltale.db elsewhere")
    message = until(lambda: storage(client), NOTICE_S, "a warning")
    assert "removed or replaced" in message, message
    goes_on(client)
    mounted.inside("mv elsewhere telltale.db")
    until(lambda: storage(client) is None, NOTICE_S, "the warning ends")


def test_nothing_is_acknowledged_that_cannot_be_kept(mounted):
    client = Client(mounted, *OPERATOR)
    mounted.inside(FILL)
    until(lambda: storage(client), NOTICE_S, "a warning")
    answers = []
    for _ in range(200):
        try:
            Client(mounted, *OPERATOR)
            answers.append(200)
        except urllib.error.HTTPError as error:
            answers.append(error.code)
            if error.code == 503:
                break
    assert answers[-1] == 503, f"the log on a full disk has room for everything: {answers}"
    goes_on(client)
    mounted.inside("rm fill rest")
    until(lambda: storage(client) is None, NOTICE_S, "the warning ends")
    assert json.loads(client.post("/logout") or b"{}") == {}
    assert mounted.inside(f"{TELLTALE} audit verify --data .").startswith("ok")
