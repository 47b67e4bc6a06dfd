"""Two ranks on one machine (gloo), started by torchrun as a user would."""

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file

from hotice.learn import distributed
from hotice.learn.checkpoints.checkpoint import load_checkpoint
from hotice.learn.ppo.config import PpoConfig
from hotice.learn.ppo.dual_ppo import DualPpo
from hotice.learn.ppo.learner import MIRROR_ROWS
from hotice.learn.ppo.networks import ActorCritic
from hotice.learn.ppo.storage import Batch, Rollout
from hotice.learn.train.runner import Runner
from hotice.sim.observations import mirror_action
from hotice.task.presets import DUAL

OBS, CRITIC, STEPS = 11, 13, 6
ENVS = {"one": 8, "several": 1600}
MINIBATCHES = {"one": 1, "several": 3}
FIELDS = ("obs", "critic_obs", "action", "mean", "log_prob", "value", "advantage")
CONFIG = PpoConfig(steps=STEPS, epochs=3, max_grad_norm=1e3, learning_rate=1e-2)

EACH_RANK = """
import atexit, json, os, sys
from pathlib import Path

def threads_left():
    names = [Path(f"/proc/self/task/{{t}}/comm").read_text().strip() for t in os.listdir("/proc/self/task")]
    Path(f"threads{{os.environ['RANK']}}.json").write_text(json.dumps(names))

atexit.register(threads_left)  # before all others: runs as the last of them
sys.path.insert(0, {tests!r})
from test_distributed import distributed, learn
from safetensors.torch import load_file, save_file

distributed.start("cpu")
for name, minibatches in {cases!r}.items():
    result = learn(load_file(f"{{name}}.safetensors"), minibatches, rank=distributed.rank(), ranks=distributed.size())
    save_file(result, f"{{name}}{{distributed.rank()}}.safetensors")
"""


IN_TURN = """
import sys
from hotice.commands.program import main

options = sys.argv[1:]
for out, updates in (("whole", "2"), ("parts", "1")):
    assert main(["train", "--out", out, "--updates", updates, *options]) == 0
"""


class Joined(Rollout):
    """A rollout whose minibatches are those of two ranks, joined: each rank shuffles rows of its own, here in the same
    order."""

    def minibatches(self, count, generator):
        halves = [
            {f: getattr(self, f).chunk(2, dim=1)[r].flatten(0, 1) for f in Batch.__dataclass_fields__} for r in (0, 1)
        ]
        total = len(halves[0]["obs"])
        for ids in torch.randperm(total, generator=generator).split(total // count):
            yield Batch(**{name: torch.cat([half[name][ids] for half in halves]) for name in halves[0]})


class EachRanksMirror(DualPpo):
    """Looks, in a joined minibatch, at the mirrored rows that the two ranks would look at."""

    def _mirror_loss(self, obs, mean):
        pairs = zip(obs.chunk(2), mean.chunk(2), strict=True)
        return sum(super(EachRanksMirror, self)._mirror_loss(*pair) for pair in pairs) / 2


def learner(kind=DualPpo, minibatches=1):
    torch.manual_seed(0)
    net = ActorCritic(DUAL, OBS, CRITIC, (16,), (16,), (0.6, 0.3))
    config = dataclasses.replace(CONFIG, minibatches=minibatches)
    return kind(net, config, lambda obs: obs.flip(-1), mirror_action, torch.Generator().manual_seed(1))


def learn(tensors, minibatches, rank=0, ranks=1, kind=DualPpo, rows=Rollout):
    """Updates from this rank's share of a rollout; returns the last gradients, weights and learning rates."""
    envs = tensors["obs"].shape[1]
    share = slice(rank * envs // ranks, (rank + 1) * envs // ranks)
    algo, rollout = learner(kind, minibatches), rows(STEPS, envs // ranks, OBS, CRITIC, 2, torch.device("cpu"))
    for name in FIELDS:
        setattr(rollout, name, tensors[name][:, share].contiguous())
    log = algo.update(rollout)
    algo.net.obs_norm.update(distributed.concatenate(rollout.obs.flatten(0, 1)))
    gradients = {f"gradient.{n}": p.grad for n, p in algo.net.named_parameters()}
    rates = {f"log.{k}": torch.tensor(v, dtype=torch.float64) for k, v in log.items() if k.startswith(("kl", "learn"))}
    return gradients | {k: v.clone() for k, v in algo.net.state_dict().items()} | rates


def make_rollout(envs):
    """One rollout of all environments, as its policy would have made it, with advantages of unequal spread."""
    algo, generator = learner(), torch.Generator().manual_seed(2)
    rows = {
        "obs": torch.randn(STEPS, envs, OBS, generator=generator),
        "critic_obs": torch.randn(STEPS, envs, CRITIC, generator=generator),
    }
    with torch.no_grad():
        rows["value"] = algo.net.values(rows["critic_obs"])
        action, mean, log_prob = algo.sample(rows["obs"].flatten(0, 1))
    rows |= {k: v.view(STEPS, envs, -1) for k, v in (("action", action), ("mean", mean), ("log_prob", log_prob))}
    rows["advantage"] = torch.randn(STEPS, envs, 2, generator=generator) * torch.linspace(0.5, 3.0, envs)[:, None] + 0.3
    return {k: v.contiguous() for k, v in rows.items()}


def torchrun(folder, *argv):
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2", *map(str, argv)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-3000:]


@pytest.mark.slow
def test_two_ranks_learn_like_one_process_with_the_joined_batch(tmp_path):
    """One minibatch of all rows; and several, whose rows are the ranks' and of whose mirror images each rank samples
    its own."""
    rollouts = {name: make_rollout(envs) for name, envs in ENVS.items()}
    assert STEPS * ENVS["several"] // 2 // MINIBATCHES["several"] >= 2 * MIRROR_ROWS, "the mirror loss leaves rows out"
    for name, rollout in rollouts.items():
        save_file(rollout, tmp_path / f"{name}.safetensors")
    (tmp_path / "each_rank.py").write_text(EACH_RANK.format(tests=str(Path(__file__).parent), cases=MINIBATCHES))
    torchrun(tmp_path, tmp_path / "each_rank.py")
    as_one = {
        "one": learn(rollouts["one"], 1),
        "several": learn(rollouts["several"], MINIBATCHES["several"], kind=EachRanksMirror, rows=Joined),
    }
    for name, alone in as_one.items():
        first, second = (load_file(tmp_path / f"{name}{r}.safetensors") for r in range(2))
        assert set(first) == set(second) == set(alone)
        for key, value in alone.items():
            where = f"{name}: {key}"
            assert torch.equal(first[key], second[key]), where
            torch.testing.assert_close(
                first[key], value, rtol=1e-5, atol=2e-6, msg=lambda m, where=where: f"{where}: {m}"
            )
        assert any(value.abs().max() > 1e-3 for key, value in alone.items() if key.startswith("gradient."))
    for rank in range(2):  # left over, they could abort the process
        threads = json.loads((tmp_path / f"threads{rank}.json").read_text())
        assert threads and not [name for name in threads if "gloo" in name]


@pytest.mark.parametrize("count", [1, 3])
def test_every_row_is_in_one_minibatch_of_an_epoch(count):
    rollout = Rollout(STEPS, 8, OBS, CRITIC, 2, torch.device("cpu"))
    rollout.obs[..., 0] = torch.arange(STEPS * 8.0).view(STEPS, 8)
    batches = list(rollout.minibatches(count, torch.Generator().manual_seed(0)))
    assert [len(batch.obs) for batch in batches] == [STEPS * 8 // count] * count
    assert torch.cat([batch.obs[:, 0] for batch in batches]).sort().values.tolist() == list(range(STEPS * 8))


@pytest.mark.slow
def test_a_run_of_two_ranks_resumes_bit_for_bit_and_goes_on_with_one(tiny, tiny_options, tmp_path):
    options = [*tiny_options, "--scenes", "open_floor", "gap", "--resume"]
    (tmp_path / "in_turn.py").write_text(IN_TURN)
    torchrun(tmp_path, tmp_path / "in_turn.py", *options)
    torchrun(tmp_path, "-m", "hotice.learn", "train", "--out", "parts", "--updates", 2, *options)
    (a, meta), (b, _) = (load_checkpoint(tmp_path / name) for name in ("whole", "parts"))
    assert set(a) == set(b) and [k for k in a if not torch.equal(a[k], b[k])] == []
    assert meta["ranks"] == 2 and meta["steps"] == 2 * 2 * 64
    assert not torch.equal(a["env.physics.qpos"], a["rank1.env.physics.qpos"]), "each rank has its own episodes"
    assert [json.loads(line)["update"] for line in (tmp_path / "whole" / "log.jsonl").open()] == [1, 2]

    config = tiny(tmp_path / "whole", updates=3, scenes=("open_floor", "gap"), resume=True)
    alone, new = Runner(config), Runner(dataclasses.replace(config, resume=False))
    assert alone.update == 2 and alone.steps == meta["steps"]
    assert all(torch.equal(value, a[f"net.{key}"]) for key, value in alone.net.state_dict().items())
    assert all(torch.equal(value, a[key]) for key, value in (alone.algo.state() | alone.average.state()).items())
    assert torch.equal(alone.curriculum.rate, a["curriculum"])
    assert torch.equal(alone.obs, new.obs) and not torch.equal(alone.env.physics.qpos, a["env.physics.qpos"])
    assert "other ranks: episodes start anew, 2 of 2 scenes" in alone.notice
    alone.train()
    _, meta = load_checkpoint(tmp_path / "whole")
    assert meta["ranks"] == 1 and meta["steps"] == 2 * 2 * 64 + 64
    assert [json.loads(line)["update"] for line in (tmp_path / "whole" / "log.jsonl").open()] == [1, 2, 3]


def test_alone_everything_is_what_it_was():
    x, parameter = torch.randn(3, 2), torch.nn.Parameter(torch.ones(2))
    parameter.grad = torch.ones(2)
    distributed.average_gradients([parameter])
    distributed.add_up([x])
    assert distributed.start("cpu") == "cpu" and distributed.rank() == 0 and distributed.size() == 1
    assert (
        distributed.concatenate(x) is x
        and distributed.mean(x) is x
        and distributed.any_rank(True, False) == [True, False]
    )
    assert distributed.collect({"x": x})[0]["x"] is x and torch.equal(parameter.grad, torch.ones(2))
