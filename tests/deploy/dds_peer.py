"""The other process of the tests over loopback: `python -m tests.deploy.dds_peer ROLE DOMAIN`, until its input ends."""

import sys
import threading
import time

import numpy as np

from hotice.deploy.dds.idl_types import packed_type
from hotice.deploy.dds.link import COMMAND_TOPIC, STATE_TOPIC, DdsRobot
from hotice.deploy.dds.node import LOOPBACK, DdsNode
from hotice.deploy.dds.ports import Writer
from hotice.deploy.dds.service import DdsServer
from hotice.deploy.messages.hg import LOW_CMD, LOW_STATE
from hotice.deploy.switcher import SERVICE
from tests.deploy.messages_fixture import low_state

MACHINE = 6


def robot(node):
    """Publishes states; says once that it has taken a command, and what was in it."""
    end, record, said = DdsRobot(node), low_state(np.random.default_rng(0), machine=MACHINE), False

    def step():
        nonlocal said
        record["tick"] += 2
        end.publish_state(record)
        command = end.command()
        if command is not None and not said:
            said = True
            print(
                "command", int(command.record["mode_machine"]), float(command.record["motor_cmd"]["q"][3]), flush=True
            )

    return step


def commander(node):
    writer = Writer(node, COMMAND_TOPIC, packed_type(LOW_CMD))
    return lambda: writer.write(b"\0\1\0\0" + bytes(1000))


def babbler(node):
    """Rubbish beside good states; shorter rubbish Cyclone itself does not send."""
    step, writer, rng = robot(node), Writer(node, STATE_TOPIC, packed_type(LOW_STATE)), np.random.default_rng(0)

    def both():
        step()
        writer.write(b"\0\1\0\0" + rng.bytes(2088 + 4 * int(rng.integers(0, 2))))

    return both


def server(node):
    names = ["ai"]

    def answer(api_id, parameter):
        if api_id == 1003:
            names[0] = ""
        return (0, f'{{"form":"0","name":"{names[0]}"}}') if api_id in (1001, 1003) else (3203, "")

    end = DdsServer(node, SERVICE, answer)
    return end.serve


ROLES = {role.__name__: role for role in (robot, commander, babbler, server)}

if __name__ == "__main__":
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    with DdsNode(domain=int(sys.argv[2]), interface=LOOPBACK) as this_node:
        turn = ROLES[sys.argv[1]](this_node)
        while not ended.is_set():
            turn()
            time.sleep(0.002)
        del turn
