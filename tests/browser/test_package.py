"""The Debian package: what lintian says of it, and how it is installed, run by systemd, upgraded, removed and purged in a Debian
of its own; and the hardening of the unit.

`tests/run.sh` prepares the package and the Debian, and names them in TELLTALE_TEST_DEB and TELLTALE_TEST_DEBIAN. The test
needs root.
"""

import contextlib
import os
import re
import signal
import subprocess
from pathlib import Path

from vehicle import ROOT, STARTUP_S, until

PACKAGE = ROOT / os.environ.get("TELLTALE_TEST_DEB", "")
UNIT = ROOT / "packaging/telltale.service"
# Links of the documentation to files that the source has and the package not, or under another name.
SOURCE_ONLY = ("CHANGELOG.md", "CONTRIBUTING.md", "LICENSE", "Containerfile", "packaging/", "fuzz/")
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
    """A Debian in a folder. At first nothing runs there."""

    def __init__(self, root):
        self.root = root
        self.systemd = None
        subprocess.run(["tar", "-xf", os.environ["TELLTALE_TEST_DEBIAN"], "-C", root], check=True, timeout=120)

    def words(self, *words):
        """In the system that was started, else in a mount namespace of its own, with /proc and /dev."""
        if self.systemd:
            return ["nsenter", f"--target={self.systemd}", "--mount", "--uts", "--ipc", "--net", "--pid", "--cgroup", *map(str, words)]
        script = 'mount -t proc proc "$0/proc"; mount --rbind /dev "$0/dev"; exec "$@"'
        chroot = ["chroot", str(self.root), *map(str, words)]
        return ["unshare", "--mount", "--propagation", "private", "sh", "-ec", script, str(self.root), *chroot]

    def run(self, *words, fails=False, **more):
        done = subprocess.run(self.words(*words), capture_output=True, text=True, timeout=300, env=ENVIRONMENT, **more)
        assert (done.returncode != 0) == fails, done.stdout + done.stderr
        return done.stdout + done.stderr

    def dpkg(self, *words):
        return self.run("dpkg", *words)

    def install(self, package):
        with (self.root / "package.deb").open("wb") as copy:
            copy.write(package.read_bytes())
        return self.dpkg("--install", "/package.deb")

    def path(self, path):
        return self.root / path.lstrip("/")

    @contextlib.contextmanager
    def started(self):
        """With systemd as its first process, and a network of its own, which has the loopback interface only."""
        name = f"telltale-test-{os.getpid()}"
        words = ["systemd-nspawn", "--boot", "--register=no", "--keep-unit", "--link-journal=no", "--private-network"]
        with (self.root.parent / "boot.log").open("wb") as log:
            container = subprocess.Popen([*words, f"--machine={name}", f"--directory={self.root}"], stdin=subprocess.DEVNULL, stdout=log, stderr=log)
        said = lambda: (self.root.parent / "boot.log").read_text(errors="replace")
        try:
            self.systemd = until(lambda: first_process(container), STARTUP_S, said)
            until(self.answers, STARTUP_S, said)
            assert "running" in self.run("systemctl", "is-system-running", "--wait"), said()
            yield
            self.run("systemctl", "poweroff")
            assert container.wait(timeout=60) == 0, said()
        finally:
            first, self.systemd = self.systemd, None
            if container.poll() is None:
                # With its first process a container ends whole; systemd-nspawn would leave it behind.
                os.kill(first or container.pid, signal.SIGKILL if first else signal.SIGTERM)
                container.wait(timeout=60)

    def answers(self):
        words = self.words("systemctl", "show", "--property=Version")
        return subprocess.run(words, capture_output=True, timeout=60, env=ENVIRONMENT).returncode == 0

    def shows(self, key):
        return self.run("systemctl", "show", "telltale", f"--property={key}", "--value").strip()


def first_process(container):
    """The first process of a container, once it is systemd."""
    assert container.poll() is None
    for pid in Path(f"/proc/{container.pid}/task/{container.pid}/children").read_text().split():
        with contextlib.suppress(FileNotFoundError):
            if Path(f"/proc/{pid}/comm").read_text() == "systemd\n":
                return int(pid)
    return None


def newer(package, folder):
    """The same package with a higher version."""
    content = folder / "content"
    subprocess.run(["dpkg-deb", "--raw-extract", package, content], check=True, timeout=120)
    control = content / "DEBIAN/control"
    control.write_text(re.sub("^Version: (.*)$", r"Version: \1.1", control.read_text(), flags=re.MULTILINE))
    made = folder / "newer.deb"
    subprocess.run(["dpkg-deb", "-Znone", "--build", "--root-owner-group", content, made], check=True, capture_output=True, timeout=120)
    return made


def test_the_package_is_installed_started_upgraded_removed_and_purged(tmp_path):
    root = tmp_path / "debian"
    root.mkdir()
    debian = Debian(root)
    # Maintainer scripts have to do without a systemd that runs, as in a container.
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
    assert debian.run("systemctl", "is-enabled", "telltale", "telltale-display", fails=True).split() == ["disabled", "disabled"]
    conffile = debian.path("/etc/telltale/telltale.env")
    own = "TELLTALE_ARGS=--interface loopback --listen 127.0.0.1:8081\n"
    conffile.write_text(own)

    with debian.started():
        # As root; the service could not open files of root.
        data = "--data=/var/lib/telltale"
        debian.run("telltale", "user", "add", "anna", "--role=operator", data, input="975310\n975310\n")
        debian.run("telltale", "tls", "self-signed", "--name=shuttle.example", data)
        assert debian.run("find", "/var/lib/telltale", "!", "-user", "telltale") == ""
        debian.run("systemctl", "enable", "--now", "telltale")
        it_serves(debian)
        it_is_locked_up(debian)
        it_takes_a_changed_vehicle(debian)
        systemd_replaces_it_when_it_hangs(debian)
        before = debian.shows("MainPID")
        said = debian.install(newer(PACKAGE, tmp_path))
        assert "sudo" not in said, "an upgrade needs no advice"
        assert conffile.read_text() == own, "what was changed is kept"
        verified = {tuple(line.split()[1:]) for line in debian.dpkg("--verify", "telltale").splitlines()}
        assert verified <= {("c", f"/etc/telltale/{name}") for name in ("telltale.env", "vehicle.yaml")}
        assert debian.shows("MainPID") != before, "an upgrade restarts the service"
        it_serves(debian)
        debian.run("systemctl", "stop", "telltale")
        assert debian.shows("Result") == "success"

        debian.run("systemctl", "start", "telltale")
        debian.dpkg("--remove", "telltale")
        assert debian.run("systemctl", "is-active", "telltale", fails=True).strip() == "inactive"
        gone = ["/usr/bin/telltale", "/usr/lib/systemd/system/telltale.service", "/usr/share/man/man1/telltale.1"]
        assert not any(debian.path(path).exists() for path in gone)
        assert conffile.read_text() == own and debian.path("/var/lib/telltale/telltale.db").exists()
    said = debian.dpkg("--purge", "telltale")
    assert not debian.path("/etc/telltale").exists()
    assert debian.path("/var/lib/telltale/telltale.db").exists() and "/var/lib/telltale is kept" in said, said


def journal(debian, *words):
    return debian.run("journalctl", "--unit=telltale", "--output=cat", "--no-pager", *words)


def it_serves(debian):
    """systemd waited for READY=1 before `systemctl` came back."""
    assert debian.run("systemctl", "is-active", "telltale").strip() == "active"
    assert "http://127.0.0.1:8081" in debian.shows("StatusText")
    for path in ("readyz", "login"):
        words = ["curl", "--silent", "--fail", "--max-time", "5", f"http://127.0.0.1:8081/{path}"]
        done = subprocess.run(["nsenter", f"--target={debian.systemd}", "--net", *words], capture_output=True, timeout=60)
        assert done.returncode == 0, (path, journal(debian))
    # Each entry has its fields, and its priority: the address of the page is no warning.
    assert "the display is on" in journal(debian, "TELLTALE_TARGET=telltale::cli::running::server")
    assert "the display is on" in journal(debian) and "the sockets of DDS" in journal(debian, "--priority=warning")
    assert "the display is on" not in journal(debian, "--priority=warning")
    monotonic = lambda key: int(debian.shows(f"{key}TimestampMonotonic"))
    until(lambda: monotonic("Watchdog") > monotonic("ActiveEnter"), STARTUP_S, lambda: f"the watchdog is fed: {journal(debian)}")


def it_is_locked_up(debian):
    """The process has no rights, and sees of the machine what the unit leaves it."""
    main = debian.shows("MainPID")
    status = dict(line.split(":", 1) for line in debian.run("cat", f"/proc/{main}/status").splitlines())
    assert status["Uid"].split()[0] != "0" and status["NoNewPrivs"].strip() == "1" and status["Seccomp"].strip() == "2"
    assert not any(int(status[key], 16) for key in ("CapEff", "CapPrm", "CapBnd", "CapAmb"))
    for place in ("/etc", "/etc/telltale", "/usr", "/var/lib", "/root"):
        debian.run("nsenter", f"--target={main}", "--mount", "touch", f"{place}/written", fails=True)
    debian.run("nsenter", f"--target={main}", "--mount", "touch", "/var/lib/telltale/written", "/tmp/written")
    assert debian.path("/var/lib/telltale/written").exists()
    debian.run("test", "-e", "/tmp/written", fails=True)


def it_takes_a_changed_vehicle(debian):
    vehicle = debian.path("/etc/telltale/vehicle.yaml")
    vehicle.write_text(vehicle.read_text().replace("name: Vehicle 1", "name: Vehicle 2"))
    debian.run("systemctl", "reload", "telltale")
    until(lambda: "vehicle.yaml was read again and taken" in journal(debian), STARTUP_S, lambda: journal(debian))


def systemd_replaces_it_when_it_hangs(debian):
    assert debian.shows("NRestarts") == "0"
    debian.run("systemctl", "kill", "--kill-whom=main", "--signal=STOP", "telltale")
    until(lambda: debian.shows("NRestarts") == "1" and debian.shows("ActiveState") == "active", 60, lambda: journal(debian))
    assert "Watchdog timeout" in journal(debian)
    it_serves(debian)
