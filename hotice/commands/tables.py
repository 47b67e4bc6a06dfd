"""The tables of the task as Markdown, straight from the code."""

from __future__ import annotations

from hotice.sim.observations import POLICY, PRIVILEGED, SCAN, past_rows
from hotice.sim.rewards import REWARDS, TERMINATION_PENALTY, L, U
from hotice.sim.terminations import TERMINATIONS
from hotice.sim.terms import FADE_M, SPEED_EPS


def _first_line(term: object) -> str:
    return (term.__doc__ or "").strip().splitlines()[0].replace("|", "\\|")  # a bar would end the cell


def reward_table() -> str:
    """One row a reward term, and below what all cosines share."""
    rows = ["| Set | Term | Weight [1/s] | What | Source |", "|---|---|---|---|---|"]
    for r in REWARDS:
        group = "L" if r.agents == L else "U" if r.agents == U else "S"
        rows.append(f"| {group} | `{r.name}` | {r.weight:g} | {_first_line(r.term)} | {r.source} |")
    rows.append(f"| S | termination | {TERMINATION_PENALTY:g} once | An episode ends by a failure | ours |")
    rows += [
        "",
        f"Cosines are softened, a·b / ((|a| + ε)(|b| + ε)) with ε = {SPEED_EPS:g} m/s, and fade out within "
        f"{FADE_M:g} m of the goal; the object's field is taken at the commanded speed, F·speed/η. Both are ours: see "
        "`docs/notation.md`.",
    ]
    return "\n".join(rows)


def observation_table() -> str:
    """One row an observation; privileged ones are read by the critics only."""
    rows = ["| Read by | Observation | Size | What |", "|---|---|---|---|"]
    for who, table in (
        ("actors, critics", POLICY),
        ("both, with `scan`", (SCAN,)),
        ("both, with `history` of one step", (past_rows(1),)),
        ("critics", PRIVILEGED),
    ):
        rows += [f"| {who} | `{o.name}` | {len(o.mirror[0])} | {o.note} |" for o in table]
    return "\n".join(rows)


def termination_table() -> str:
    """One row a termination."""
    rows = ["| Termination | When |", "|---|---|"]
    return "\n".join(rows + [f"| `{t.name}` | {_first_line(t.condition)} |" for t in TERMINATIONS])


def all_tables() -> str:
    """Rewards, observations and terminations."""
    parts = (("Rewards", reward_table()), ("Observations", observation_table()), ("Terminations", termination_table()))
    return "\n\n".join(f"## {title}\n\n{table}" for title, table in parts)
