"""Commands by group: what each does in one line, and examples. Costs nothing to import, for `hotice --help`."""

from __future__ import annotations

import shutil
import textwrap
from collections.abc import Sequence
from typing import NamedTuple


class Entry(NamedTuple):
    """One command."""

    name: str
    says: str
    """What it does, in a line."""
    examples: tuple[str, ...] = ()
    """Whole command lines."""


Groups = dict[str, tuple[Entry, ...]]

COMMANDS: Groups = {
    "look": (
        Entry(
            "play",
            "Run a policy and write a replay page, a picture and, if asked for, a film.",
            (
                "hotice play --policy student --scene beam --out beam.html",
                "hotice play --scene pillars --rollouts 4 --video pillars.mp4",
                "hotice play --controller pickup_then_policy --scene beam --out pickup.html",
                "hotice play --scene moving20/17_oncoming --moving live",
                "hotice play --controller job --scene gap --rollouts 1 --out job.html",
                "hotice play --view --scene pillars",
            ),
        ),
        Entry(
            "watch",
            "Show a run that is trained in the browser: its curves, and walks of each new checkpoint.",
            ("hotice watch runs/first", "hotice watch runs/first --wait --rollouts 6"),
        ),
        Entry(
            "scene",
            "Import, show, check, list and generate scenes: see `hotice scene --help`.",
            ("hotice scene list", "hotice scene check beam pillars"),
        ),
        Entry(
            "warm",
            "Compile what is compiled once (about a minute), so that later commands begin at once.",
            ("hotice warm",),
        ),
        Entry("tables", "Print rewards, observations and terminations as Markdown.", ("hotice tables > tables.md",)),
    ),
    "score": (
        Entry(
            "evaluate",
            "Score a policy, or the walking baseline, with exact collision geometry.",
            (
                "hotice evaluate --policy student --scenes beam --rollouts 20 --seed 1",
                "hotice evaluate --policy student --scenes bench20 --rollouts 25 --protocol paper --out report.json",
                "hotice evaluate --controller walk --scenes gap --rollouts 4 --no-perturbed",
                "hotice evaluate --task job --policy student --scenes open_floor gap beam --rollouts 4 --out job.json",
            ),
        ),
        Entry(
            "reproduce",
            "Make the paper's tables, and its figure of unseen scenes, from given or newly trained policies.",
            ("hotice reproduce unseen --policies generalist=student --rollouts 4 --out unseen",),
        ),
        Entry(
            "benchmark",
            "Measure environment steps beside bare physics.",
            ("hotice benchmark --num-envs 256 --steps 30 --updates 1",),
        ),
    ),
    "learn": (
        Entry(
            "train",
            "Train the agents of a preset with dual PPO.",
            (
                "hotice train --scenes open_floor --num-envs 512 --max-minutes 10 --out runs/first",
                "hotice train --out runs/first --resume --max-minutes 10",
                "hotice train --scenes bench20 --out runs/seen --view",
                "hotice train --scenes bench20 --scan --history 5 --perturbed --out runs/second",
            ),
        ),
        Entry(
            "distill",
            "Make one student of several teachers (DAgger), under noise, delays and pushes.",
            ("hotice distill --generalist runs/first --scenes bench20 --out runs/student",),
        ),
        Entry(
            "finetune",
            "Go on from a student with dual PPO, under noise, delays and pushes.",
            ("hotice finetune --init runs/student --scenes bench20 --out runs/tuned",),
        ),
        Entry(
            "pickup",
            "Plan, learn and score pick-ups: see `hotice pickup --help`.",
            ("hotice pickup evaluate --policy teacher --picks picks.npz",),
        ),
        Entry(
            "merge",
            "Average branches of one run, weight by weight, into one checkpoint.",
            ("hotice merge --parts runs/a runs/b --out runs/ab",),
        ),
        Entry(
            "export",
            "Write a policy as one ONNX file.",
            ("hotice export --policy runs/tuned --out tuned.onnx",),
        ),
        Entry(
            "pipeline",
            "Run a graph of jobs: teachers, student, fine-tuning, evaluation, export.",
            ("hotice pipeline small.yaml --workers 2",),
        ),
    ),
    "robot": (
        Entry(
            "robot-sim",
            "Simulate a robot in real time, on the messages of the real one.",
            ("hotice robot-sim --scene gap",),
        ),
        Entry(
            "robot-check",
            "Look at what a robot sends, before it moves: one table, pass or fail with the number.",
            ("hotice robot-check --scene gap",),
        ),
        Entry(
            "deploy",
            "Have a robot, simulated or real, carry its object to a scene's goal; `deploy replay LOG`: do it again.",
            ("hotice deploy --scene gap --view", "hotice deploy replay LOG --html replay.html"),
        ),
        Entry(
            "tags",
            "Make the sheets of tags that a robot's camera knows a box by, to be printed.",
            ("hotice tags --box 0.3 0.3 0.25 --out tags.pdf",),
        ),
        Entry(
            "tag-camera",
            "Read a camera, and send where the tags of the box are in its pictures.",
            ("hotice tag-camera --camera FOLDER",),
        ),
    ),
}

SCENES: Groups = {
    "scenes": (
        Entry("list", "List the scenes, sets and families that hotice brings along.", ("hotice scene list",)),
        Entry(
            "show",
            "Open scenes in meshcat.",
            ("hotice scene show beam --html beam.html", "hotice scene show beam pillars --arrows"),
        ),
        Entry(
            "check",
            "Say which scenes are valid, reachable and traversable; status 1 when one is not.",
            ("hotice scene check beam my_scene.json family:gap:3",),
        ),
        Entry(
            "generate",
            "Write generated scenes as files and report the rejected draws.",
            ("hotice scene generate family:gap:10 --out scenes",),
        ),
        Entry(
            "import",
            "Make a scene of a point cloud or mesh.",
            ("hotice scene import room.ply --start 0 0 --goal 2.5 0 --out room.json",),
        ),
        Entry(
            "scan",
            "Map a scene as a robot's upside-down lidar would: a point cloud to import, as FAST-LIO saves it.",
            ("hotice scene scan gap --out gap.pcd",),
        ),
        Entry(
            "import-front3d",
            "Crop scenes from a house of the 3D-FRONT data set.",
            ("hotice scene import-front3d --house HOUSE.json --models 3D-FUTURE-model --out scenes",),
        ),
    ),
}

PICKUPS: Groups = {
    "pick-ups": (
        Entry(
            "plan",
            "Plan random picks and write them as one book: what teachers follow, and what is picked where.",
            ("hotice pickup plan --count 64 --shapes box --out picks.npz",),
        ),
        Entry(
            "distill",
            "Make a student of a book of picks (DAgger), under noise and delays.",
            ("hotice pickup distill --picks picks.npz --out runs/pickup",),
        ),
        Entry(
            "train",
            "Go on from a student with dual PPO, under noise and delays.",
            ("hotice pickup train --picks picks.npz --init runs/pickup --out runs/pickup-ppo",),
        ),
        Entry(
            "evaluate",
            "Score a policy, or the book itself, by the protocol `robot`: lifted, in the carry state, held for 5 s.",
            ("hotice pickup evaluate --policy runs/pickup --picks unseen.npz --rollouts 100",),
        ),
    ),
}
ABOUT_PICKUPS = "Pick-ups: plan a book of them, make a student of it, improve the student, score it."

ABOUT = "A Unitree G1 humanoid carries objects through clutter: look, score, learn, and reach a robot."
NOTES = (
    "--help behind a command shows every option, with examples.",
    "Completion: hotice --tyro-print-completion bash (or zsh, tcsh, fish) > FILE, then source FILE.",
)


def names(groups: Groups) -> list[str]:
    """Names of all commands."""
    return [entry.name for entries in groups.values() for entry in entries]


def find(groups: Groups, name: str) -> Entry | None:
    """The command of that name."""
    return next((entry for entries in groups.values() for entry in entries if entry.name == name), None)


def overview(program: str, groups: Groups, about: str = ABOUT, notes: Sequence[str] = NOTES) -> str:
    """Help of a program: its commands by group, and the first example of each group."""
    width = min(120, max(60, shutil.get_terminal_size().columns))
    longest = max(map(len, names(groups)))
    lines = [f"usage: {program} COMMAND [OPTIONS]", "", *textwrap.wrap(about, width)]
    for group, entries in groups.items():
        lines += ["", group]
        for entry in entries:
            begin = f"  {entry.name:<{longest}}  "
            lines += textwrap.wrap(entry.says, width, initial_indent=begin, subsequent_indent=" " * len(begin))
    firsts = [entry.examples[0] for entries in groups.values() for entry in entries if entry.examples]
    lines += ["", "examples", *(f"  {line}" for line in (firsts[:1] if len(groups) == 1 else _first(groups)))]
    lines += ["", *(part for note in notes for part in textwrap.wrap(note, width, break_on_hyphens=False))]
    return "\n".join(lines)


def examples(entry: Entry) -> str:
    """Examples of one command, as its help shows them at the end; empty where it has none."""
    return "\n".join(["examples:", *(f"  {line}" for line in entry.examples), ""]) if entry.examples else ""


def _first(groups: Groups) -> list[str]:
    return [entries[0].examples[0] for entries in groups.values()]
