"""Login at the console by OpenID Connect, with a real issuer: somebody sees the vehicles of the grant and nothing of others,
a login that is not this browser's is refused, and local users log in while the issuer is away."""

import contextlib
import json
import re
import urllib.request

import pytest
from playwright.sync_api import expect

from accessible import violations
from hub import CONFIG, running_console, running_hub
from operating import enter
from programs import PYTHON, Program
from vehicle import Client, Server, free_port, own_domain, until

OWN, FOREIGN = "shuttle-03", "robot-01"
PEOPLE = {
    "anna": {"preferred_username": "anna", "groups": ["staff", "north"]},
    "ben": {"preferred_username": "ben", "groups": ["staff"]},
}
pytestmark = pytest.mark.timed

SECRET = "three words apart"
HEARD_S = 60


class Issuer:
    def __init__(self, log):
        self.port, self.log = free_port(), log
        self.url, self.program = f"http://127.0.0.1:{self.port}", None

    def start(self):
        if self.program:
            return
        self.program = Program(PYTHON, "-m", "oidc_provider_mock", "--port", self.port, log=self.log)
        until(self.answers, 30, lambda: f"the issuer answers: {self.log.read_text()}")
        for sub, claims in PEOPLE.items():
            self.ask(f"/users/{sub}", json.dumps(claims).encode())

    def stop(self):
        if self.program:
            self.program.kill()
        self.program = None

    def ask(self, path, body=None):
        words = {"Content-Type": "application/json"}
        request = urllib.request.Request(self.url + path, body, words, method="PUT" if body else "GET")
        return urllib.request.urlopen(request, timeout=5).read()

    def answers(self):
        with contextlib.suppress(OSError):
            return self.ask("/.well-known/openid-configuration")


@pytest.fixture(scope="module")
def issuer(tmp_path_factory):
    issuer = Issuer(tmp_path_factory.mktemp("issuer") / "issuer.log")
    yield issuer
    issuer.stop()


@pytest.fixture(scope="module")
def console(issuer, tmp_path_factory):
    """A console over two vehicles, which both were heard. It starts before the issuer."""
    root = tmp_path_factory.mktemp("oidc")
    secret = root / "client.secret"
    secret.write_text("between the two of us\n")
    secret.chmod(0o600)
    flags = ["--oidc", issuer.url, "--oidc-client", "telltale", "--oidc-secret", secret]
    with contextlib.ExitStack() as stack:
        hub = stack.enter_context(running_hub(root, OWN, FOREIGN))
        grants = ["--oidc-grant", "north=engineer:shuttle-*"]
        server = stack.enter_context(running_console(root, hub, *flags, *grants))
        server.add_user("local", SECRET, "control_room")
        for step, (id, module) in enumerate([(OWN, "lidar"), (FOREIGN, "gripper")]):
            data = root / id
            data.mkdir()
            config = data / "vehicle.yaml"
            config.write_text(CONFIG.format(id=id, module=module, url=hub[1], hub=hub[0]))
            vehicle = Server(data, own_domain() + 40 * step, config=config).start()
            stack.callback(vehicle.stop)
        client = Client(server, "local", SECRET)
        until(lambda: {it["id"] for it in vehicles(client)} == {OWN, FOREIGN}, HEARD_S, lambda: f"both are heard: {vehicles(client)}")
        yield server


def vehicles(client):
    with client.opener.open(client.server.url + "/api/v1/vehicles", timeout=10) as answer:
        return json.loads(answer.read())


def without_network(context):
    """The issuer's page has a stylesheet from elsewhere."""
    context.route(re.compile("^https://"), lambda route: route.fulfill(body="", content_type="text/css"))
    return context


def begin(page, console, issuer):
    issuer.start()
    without_network(page.context)
    page.goto(console.url + "/")
    page.get_by_role("link", name="Log in with 127.0.0.1").click()
    page.wait_for_url(re.compile("/oauth2/authorize"))


def approve(page, who):
    """Logs in at the issuer. Returns the address where the browser comes back."""
    with page.expect_request(re.compile("/login/oidc/back")) as back:
        page.locator("input[name=sub]").fill(who)
        page.locator("input[name=sub]").press("Enter")
    return back.value.url


def test_while_the_issuer_is_away_users_who_are_kept_here_log_in(console, issuer, page, trouble):
    issuer.stop()

    def is_away():
        return page.request.get(console.url + "/login/oidc", max_redirects=0).status == 503

    # If it was there before, its description of itself counts for a minute.
    until(is_away, 90, "the console notices")
    page.goto(console.url + "/login/oidc")
    expect(page.get_by_role("alert")).to_contain_text("The login service does not answer")
    trouble.expect("503")
    enter(page, console, "local", SECRET)
    expect(page.locator("#vehicles > li")).to_have_count(2)
    page.get_by_role("button", name="Log out").click()
    issuer.start()
    until(lambda: not is_away(), 30, "the console asks again")


def test_somebody_logs_in_at_the_issuer_sees_some_vehicles_and_logs_out(console, issuer, page, trouble):
    begin(page, console, issuer)
    page.go_back()
    assert not violations(page)
    begin(page, console, issuer)
    back = approve(page, "anna")
    page.wait_for_url(console.url + "/")
    expect(page.locator(".user")).to_have_text("anna@127.0.0.1")
    expect(page.locator("#vehicles > li")).to_have_count(1)
    expect(page.locator(f"#v-{OWN}")).to_be_visible()
    for path in ("/", "/incidents", f"/?q={FOREIGN[:4]}", "/api/v1/vehicles", "/api/v1/groups"):
        assert FOREIGN not in page.request.get(console.url + path).text(), path
    for path in ("", "/state", "/log"):
        assert page.request.get(f"{console.url}/vehicles/{OWN}{path}").status == 200
        assert page.request.get(f"{console.url}/vehicles/{FOREIGN}{path}").status == 404
    page.get_by_role("button", name="Log out").click()
    page.wait_for_url(console.url + "/login")
    assert page.request.get(console.url + "/overview").status == 401
    # The address of a login that is over opens nothing.
    trouble.expect("401")
    assert page.goto(back).status == 400
    expect(page.get_by_role("alert")).to_contain_text("Begin again")
    trouble.expect("400")
    assert not violations(page)


def test_it_needs_no_scripts(console, issuer, chromium, trouble):
    context = chromium.new_context(locale="de-DE", java_script_enabled=False)
    page = without_network(context).new_page()
    issuer.start()
    page.goto(console.url + "/")
    page.get_by_role("link", name="Anmelden mit 127.0.0.1").click()
    approve(page, "anna")
    page.wait_for_url(console.url + "/")
    expect(page.locator(".user")).to_have_text("anna@127.0.0.1")
    context.close()


def test_a_login_of_another_browser_or_with_another_state_is_refused(console, issuer, chromium, page, trouble):
    begin(page, console, issuer)
    with page.expect_request(re.compile("/login/oidc/back")) as sent:
        page.route(re.compile("/login/oidc/back"), lambda route: route.abort())
        page.locator("input[name=sub]").fill("anna")
        page.locator("input[name=sub]").press("Enter")
    page.unroute(re.compile("/login/oidc/back"))
    back = sent.value.url
    trouble.expect("ERR_FAILED")
    # As its next navigation: the page itself still leaves the aborted one.
    assert page.request.get(back.replace("state=", "state=x")).status == 400
    context = chromium.new_context(locale="en-GB")
    stranger = context.new_page()
    assert stranger.goto(back).status == 400
    expect(stranger.get_by_role("alert")).to_contain_text("begun in another browser")
    context.close()


def test_without_a_grant_the_page_says_so(console, issuer, page, trouble):
    begin(page, console, issuer)
    approve(page, "ben")
    expect(page.get_by_role("alert")).to_contain_text("You are logged in as ben@127.0.0.1, but have no role here.")
    assert not violations(page)
    trouble.expect("403")
