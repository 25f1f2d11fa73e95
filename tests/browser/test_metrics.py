"""Metrics of the real program, read by a real Prometheus: each is documented, and the dashboard's expressions have values."""

import contextlib
import json
import re
import urllib.error
import urllib.parse
import urllib.request

import pytest

from programs import ROOT, Program, until
from vehicle import Client, Server, free_port, own_domain

# Without a fault there is no such series.
ONLY_IN_A_FAULT = {"telltale_root_cause_masked_nodes"}
CONFIG = """
global: { scrape_interval: 500ms, scrape_timeout: 500ms }
scrape_configs:
  - { job_name: telltale, static_configs: [ { targets: ['127.0.0.1:%d'] } ] }
"""


@pytest.fixture(scope="module")
def metrics_port():
    return free_port()


@pytest.fixture(scope="module")
def demo(tmp_path_factory, metrics_port):
    flags = ["--robot", "--metrics", f"127.0.0.1:{metrics_port}"]
    server = Server(tmp_path_factory.mktemp("demo"), own_domain() + 40, "demo", flags).start()
    yield server
    assert server.stop() == 0


@pytest.fixture(scope="module")
def prometheus(tmp_path_factory, demo, metrics_port):
    """Answers a query with its values, each as its labels and a number."""
    folder, port = tmp_path_factory.mktemp("prometheus"), free_port()
    (folder / "prometheus.yml").write_text(CONFIG % metrics_port)
    words = ["prometheus", f"--config.file={folder}/prometheus.yml", f"--storage.tsdb.path={folder}/data"]
    words += [f"--web.listen-address=127.0.0.1:{port}", "--log.level=warn"]
    log = folder / "prometheus.log"
    program = Program(*words, log=log)

    def query(expression):
        address = f"http://127.0.0.1:{port}/api/v1/query?" + urllib.parse.urlencode({"query": expression})
        try:
            with urllib.request.urlopen(address, timeout=10) as answer:
                return json.load(answer)["data"]["result"]
        except urllib.error.HTTPError as error:
            # It is starting.
            if error.code == 503:
                raise
            raise AssertionError(f"{expression}: {error.read().decode()}") from None

    def is_up():
        with contextlib.suppress(urllib.error.URLError, ConnectionError, TimeoutError):
            return value(query('up{job="telltale"}')) == 1

    try:
        until(is_up, 30, lambda: f"prometheus has read the metrics: {log.read_text()}")
        yield query
    finally:
        program.close(seconds=20)


def value(result):
    return float(result[0]["value"][1]) if result else None


def read(port, path="/metrics", **headers):
    request = urllib.request.Request(f"http://127.0.0.1:{port}{path}", headers=headers)
    with urllib.request.urlopen(request, timeout=10) as answer:
        return answer.read().decode()


def test_every_metric_is_documented_and_every_documented_one_is_served(demo, metrics_port):
    served = set()
    for name, kind in re.findall(r"^# TYPE (\S+) (\S+)$", read(metrics_port), re.MULTILINE):
        served.add(name + "_total" if kind == "counter" else name)
    of_a_vehicle = (ROOT / "docs/metrics.md").read_text().split("## The console of a fleet")[0]
    documented = set(re.findall(r"^\| `(telltale_\w+)` \|", of_a_vehicle, re.MULTILINE))
    assert served == documented


@pytest.mark.parametrize("path, headers, status", [
    ("/", {}, 404),
    ("/api/v1/snapshot", {}, 404),
    ("/metrics", {"Host": "attacker.example"}, 403),
])
def test_nothing_else_is_served_and_no_page_from_elsewhere_reads_it(demo, metrics_port, path, headers, status):
    with pytest.raises(urllib.error.HTTPError) as refused:
        read(metrics_port, path, **headers)
    assert refused.value.code == status and "telltale_" not in refused.value.read().decode()


def expressions():
    dashboard = json.loads((ROOT / "docs/grafana/telltale.json").read_text())
    return [target["expr"].replace("$__rate_interval", "15s") for panel in dashboard["panels"] for target in panel["targets"]]


def test_prometheus_takes_every_expression_of_the_dashboard(prometheus):
    empty = lambda: [it for it in expressions() if it not in ONLY_IN_A_FAULT and not prometheus(it)]
    # A rate needs two readings.
    until(lambda: not empty(), 30, lambda: f"every panel has values; without: {empty()}")


def test_a_fault_comes_and_goes_in_prometheus(demo, prometheus):
    client = Client(demo, "developer", "demo-developer")
    # No group takes the statuses of `other`, so they do not count.
    failing = lambda: prometheus('telltale_group_state{group!="other", state=~"error|unknown"} == 1')
    until(lambda: not failing() and value(prometheus("telltale_root_causes")) == 0, 40, lambda: f"all is well: {failing()}")
    client.post("/demo/fault", name="lidar_outage", active="true")
    until(lambda: prometheus("telltale_root_cause_masked_nodes"), 30, "a root cause is read")
    assert failing() and value(prometheus("telltale_alarms_raised_total")) >= 1
    client.post("/demo/fault", name="lidar_outage", active="false")
    until(lambda: not prometheus("telltale_root_cause_masked_nodes"), 40, "it is gone")
