"""The services of a running server, called by clients of Cyclone DDS and of Fast DDS, and its log on /rosout."""

from programs import peer, until
from vehicle import Writer, serving

CONFIG = """
vehicle: { stages: none }
services: { acknowledge: true, reset: true, reload: true, mark: true }
groups: [{ id: base, modules: [{ id: motor, status: motor, latch: 100ms }] }]
"""


def call(server, vendor, name, **argument):
    """One call by a client of its own: its answer."""
    kind = "diagnostic_msgs::srv::dds_::AddDiagnostics" if argument else "std_srvs::srv::dds_::Trigger"
    client = peer(server.domain, "--dds", vendor, "client", "--service", f"/telltale/{name}", "--type", kind)
    try:
        client.tell(wait_matched=1, timeout=30)
        until(lambda: client.said("matched"), 35, f"the service {name}")
        client.tell(**argument)
        until(lambda: [it for it in client.said("reply") if it["mine"]], 20, f"an answer of {name}")
        reply = next(it for it in client.said("reply") if it["mine"])["reply"]
        return reply["success"], reply["message"]
    finally:
        client.kill()


def test_nodes_call_every_service_and_read_the_log(tmp_path):
    nodes_call_every_service(tmp_path, ["cyclone", "fastdds"])


def nodes_call_every_service(tmp_path, vendors, flags=()):
    first, second = vendors
    config = tmp_path / "vehicle.yaml"
    config.write_text(CONFIG)
    with serving(tmp_path, config=config, flags=flags) as server:
        log = peer(server.domain, "--dds", first, "--durability", "transient_local", "sub", "--topic", "rt/rosout=Log")
        motor = Writer(server.domain, "rt/diagnostics", "DiagnosticArray", tmp_path / "motor.log", options=("--dds", first))

        def report(level):
            motor.write(statuses=[{"name": "motor", "level": level, "message": "too hot"}])

        def logged(words):
            return [it["value"] for it in log.said("value") if words in it["value"]["msg"]]

        def is_logged(words, level):
            def again():
                report(level)
                return logged(words)

            until(again, 30, f"{words!r} on /rosout")
            return logged(words)[0]

        try:
            line = is_logged("base/motor is ERROR: too hot", 2)
            assert (line["level"], line["name"]) == (40, "telltale.root_cause")
            assert call(server, first, "acknowledge", text="base/motor")[0]
            success, message = call(server, second, "reset", text="base/motor")
            assert not success and "base/motor" in message, message
            for _ in range(5):
                report(0)
            until(lambda: call(server, second, "reset", text="base/motor")[0], 30, "a reset")
            is_logged("base/motor is no root cause any more", 0)
            success, message = call(server, second, "mark")
            assert success and message.startswith("incident "), message
            assert call(server, first, "reload") == (True, "the file means the same as what runs")
            config.write_text(CONFIG.replace("100ms", "perhaps"))
            success, message = call(server, second, "reload")
            assert not success and "perhaps" in message, message
            refused = is_logged("was read again and refused", 0)
            assert (refused["level"], refused["name"]) == (40, "telltale")
        finally:
            motor.close()
            log.kill()
