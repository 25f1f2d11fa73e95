"""The Debian package: installed, started by the line of its unit, upgraded, removed and purged in a Debian of its own; and
the hardening of the unit.

`tests/run.sh` prepares the package and the Debian, and names them in TELLTALE_TEST_DEB and TELLTALE_TEST_DEBIAN. The test
needs root.
"""

import contextlib
import os
import re
import shlex
import socket
import subprocess
import urllib.request
from pathlib import Path

from vehicle import ROOT, STARTUP_S, free_port, own_domain, until

PACKAGE = ROOT / os.environ.get("TELLTALE_TEST_DEB", "")
UNIT = ROOT / "packaging/telltale.service"
# Links of the documentation to files that the source has and the package not, or under another name.
SOURCE_ONLY = ("CHANGELOG.md", "LICENSE", "Containerfile", "packaging/", "fuzz/")
# A container of the test has no systemd that runs: maintainer scripts have to do without.
ENVIRONMENT = {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "DEBIAN_FRONTEND": "noninteractive", "LC_ALL": "C.UTF-8"}


def test_lintian_has_nothing_to_say():
    # A warning about root, or about a tag that this lintian does not know, makes no failure.
    words = ["lintian", "--no-cfg", "--allow-root", "--fail-on=error,warning", "--tag-display-limit=0", str(PACKAGE)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_changelog_of_the_package_has_its_version():
    version = subprocess.run(["dpkg-deb", "--field", PACKAGE, "Version"], capture_output=True, text=True, check=True, timeout=60).stdout.strip()
    assert (ROOT / "packaging/changelog").read_text().startswith(f"telltale ({version}) ")


def test_links_of_the_documentation_lead_to_files_of_the_package(tmp_path):
    subprocess.run(["dpkg-deb", "--extract", PACKAGE, tmp_path], check=True, timeout=120)
    top = tmp_path / "usr/share/doc/telltale"
    pages = [top / "README.md", *top.glob("docs/**/*.md")]
    assert len(pages) > 30
    broken = []
    for page in pages:
        for link in re.findall(r"\]\(([^)\s#]+)", page.read_text()):
            target = Path(os.path.normpath(page.parent / link))
            if not re.match(r"[a-z]+:", link) and not target.exists() and not str(target.relative_to(top)).startswith(SOURCE_ONLY):
                broken.append(f"{page.relative_to(top)}: {link}")
    assert broken == []


def test_the_unit_exposes_little():
    words = ["systemd-analyze", "security", "--offline=true", "--threshold=30", "--no-pager", str(UNIT)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stdout + done.stderr


class Debian:
    """A Debian in a folder."""

    def __init__(self, root):
        self.root = root
        subprocess.run(["tar", "-xf", os.environ["TELLTALE_TEST_DEBIAN"], "-C", root], check=True, timeout=120)

    def words(self, *words, user=None):
        """In a mount namespace of its own, with /proc and /dev."""
        become = [f"--userspec={user}"] if user else []
        script = 'mount -t proc proc "$0/proc"; mount --rbind /dev "$0/dev"; exec "$@"'
        chroot = ["chroot", *become, str(self.root), *map(str, words)]
        return ["unshare", "--mount", "--propagation", "private", "sh", "-ec", script, str(self.root), *chroot]

    def run(self, *words, **more):
        done = subprocess.run(self.words(*words), capture_output=True, text=True, timeout=300, env=ENVIRONMENT, **more)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout + done.stderr

    def dpkg(self, *words):
        return self.run("dpkg", *words)

    def install(self, package):
        with (self.root / "package.deb").open("wb") as copy:
            copy.write(package.read_bytes())
        return self.dpkg("--install", "/package.deb")

    def path(self, path):
        return self.root / path.lstrip("/")


def newer(package, folder):
    """The same package with a higher version."""
    content = folder / "content"
    subprocess.run(["dpkg-deb", "--raw-extract", package, content], check=True, timeout=120)
    control = content / "DEBIAN/control"
    control.write_text(re.sub("^Version: (.*)$", r"Version: \1.1", control.read_text(), flags=re.MULTILINE))
    made = folder / "newer.deb"
    subprocess.run(["dpkg-deb", "-Znone", "--build", "--root-owner-group", content, made], check=True, capture_output=True, timeout=120)
    return made


def settings(text):
    """The lines `Key=value` of a unit or of its environment file; a key may be there several times."""
    lines = text.replace("\\\n", " ").splitlines()
    return [line.split("=", 1) for line in lines if re.match(r"[A-Za-z_]+=", line)]


@contextlib.contextmanager
def service(debian, notify):
    """The program, started as the unit says."""
    unit = settings(debian.path("/usr/lib/systemd/system/telltale.service").read_text())
    value = dict(unit)
    environment = dict(settings(debian.path(value["EnvironmentFile"].removeprefix("-")).read_text()))
    words = []
    for word in shlex.split(value["ExecStart"]):
        # A variable without braces is split into words (systemd.service(5)).
        words += shlex.split(environment.get(word[1:], "")) if word.startswith("$") else [word]
    user = f"{value['User']}:{value['Group']}"

    env = {**ENVIRONMENT, **environment, "NOTIFY_SOCKET": notify, "WATCHDOG_USEC": f"{value['WatchdogSec']}000000"}
    log = open(debian.root / "serve.log", "ab")
    process = subprocess.Popen(debian.words(*words, user=user), stdout=log, stderr=log, stdin=subprocess.DEVNULL, env=env)
    try:
        yield process
    finally:
        process.terminate()
        code = process.wait(timeout=10)
        log.close()
    assert code == 0, (debian.root / "serve.log").read_text()


def test_the_package_is_installed_started_upgraded_removed_and_purged(tmp_path):
    root = tmp_path / "debian"
    root.mkdir()
    debian = Debian(root)
    said = debian.install(PACKAGE)
    assert "sudo -u telltale telltale user add" in said, said
    users = debian.path("/etc/passwd").read_text()
    assert "\ntelltale:" in users and "\ntelltale-display:" in users, users
    assert debian.run("stat", "-c", "%U:%G %a", "/var/lib/telltale").split("\n")[0] == "telltale:telltale 700"
    assert "telltale-serve - " in debian.run("sh", "-c", "sed -n 's/\\\\//g; /^telltale/p' /usr/share/man/man1/telltale-serve.1")
    for shell in ("/usr/share/bash-completion/completions/telltale", "/usr/share/zsh/vendor-completions/_telltale"):
        assert debian.path(shell).is_file()
    debian.run("bash", "-c", "source /usr/share/bash-completion/completions/telltale; complete -p telltale")
    debian.run("telltale", "check", "--strict", "/etc/telltale/vehicle.yaml")
    enabled = subprocess.run(debian.words("systemctl", "is-enabled", "telltale", "telltale-display"), capture_output=True, text=True, env=ENVIRONMENT)
    assert enabled.stdout.split() == ["disabled", "disabled"], enabled.stdout + enabled.stderr
    add = ["telltale", "user", "add", "anna", "--role", "operator", "--data", "/var/lib/telltale"]
    added = subprocess.run(debian.words(*add, user="telltale:telltale"), input="975310\n975310\n", text=True, capture_output=True, env=ENVIRONMENT)
    assert added.returncode == 0, added.stdout + added.stderr

    port = free_port()
    own = f"TELLTALE_ARGS=--interface loopback --domain {own_domain()} --listen 127.0.0.1:{port}\n"
    conffile = debian.path("/etc/telltale/telltale.env")
    conffile.write_text(own)
    starts_and_answers(debian, port)
    said = debian.install(newer(PACKAGE, tmp_path))
    assert "sudo" not in said, "an upgrade needs no advice"
    assert conffile.read_text() == own, "what was changed is kept"
    assert debian.dpkg("--verify", "telltale").split() in ([], ["??5??????", "c", "/etc/telltale/telltale.env"])
    starts_and_answers(debian, port)

    debian.dpkg("--remove", "telltale")
    gone = ["/usr/bin/telltale", "/usr/lib/systemd/system/telltale.service", "/usr/share/man/man1/telltale.1"]
    assert not any(debian.path(path).exists() for path in gone)
    assert conffile.read_text() == own and debian.path("/var/lib/telltale/telltale.db").exists()
    said = debian.dpkg("--purge", "telltale")
    assert not debian.path("/etc/telltale").exists()
    assert debian.path("/var/lib/telltale/telltale.db").exists() and "/var/lib/telltale is kept" in said, said


def starts_and_answers(debian, port):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        # The limit of a socket's name is short, the folder of a test is long: the name without a path.
        name = f"telltale-test-{port}"
        systemd.bind(f"\0{name}")
        systemd.setblocking(False)
        said = []

        def is_fed():
            with contextlib.suppress(BlockingIOError):
                said.extend(systemd.recv(4096).decode().splitlines())
            assert process.poll() is None, (debian.root / "serve.log").read_text()
            return "READY=1" in said and "WATCHDOG=1" in said

        with service(debian, f"@{name}") as process:
            until(is_fed, STARTUP_S, lambda: f"it is ready and alive: {said}\n{(debian.root / 'serve.log').read_text()}")
            for path in ("healthz", "login"):
                with urllib.request.urlopen(f"http://127.0.0.1:{port}/{path}", timeout=5) as answer:
                    assert answer.status == 200
