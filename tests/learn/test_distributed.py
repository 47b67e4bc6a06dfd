"""Two ranks on one machine (gloo), started by torchrun as a user would."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file

from hotice.learn import distributed
from hotice.learn.checkpoint import load_checkpoint
from hotice.learn.config import PpoConfig
from hotice.learn.dual_ppo import DualPpo
from hotice.learn.networks import ActorCritic
from hotice.learn.storage import Rollout
from hotice.sim.config import DUAL
from hotice.sim.observations import mirror_action

OBS, CRITIC, STEPS, ENVS = 11, 13, 6, 8
FIELDS = ("obs", "critic_obs", "action", "mean", "log_prob", "value", "advantage")
CONFIG = PpoConfig(steps=STEPS, minibatches=1, epochs=3, max_grad_norm=1e3, learning_rate=1e-2)

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
result = learn(load_file("rollout.safetensors"), rank=distributed.rank(), ranks=distributed.size())
save_file(result, f"result{{distributed.rank()}}.safetensors")
"""


def learner():
    torch.manual_seed(0)
    net = ActorCritic(DUAL, OBS, CRITIC, (16,), (16,), (0.6, 0.3))
    return DualPpo(net, CONFIG, lambda obs: obs.flip(-1), mirror_action, torch.Generator().manual_seed(1))


def learn(tensors, rank=0, ranks=1):
    """Updates from this rank's share of a rollout; returns the last gradients, weights and learning rates."""
    share = slice(rank * ENVS // ranks, (rank + 1) * ENVS // ranks)
    algo, rollout = learner(), Rollout(STEPS, ENVS // ranks, OBS, CRITIC, 2, torch.device("cpu"))
    for name in FIELDS:
        setattr(rollout, name, tensors[name][:, share].contiguous())
    log = algo.update(rollout)
    algo.net.obs_norm.update(distributed.concatenate(rollout.obs.flatten(0, 1)))
    gradients = {f"gradient.{n}": p.grad for n, p in algo.net.named_parameters()}
    rates = {f"log.{k}": torch.tensor(v, dtype=torch.float64) for k, v in log.items() if k.startswith(("kl", "learn"))}
    return gradients | {k: v.clone() for k, v in algo.net.state_dict().items()} | rates


@pytest.fixture
def rollout():
    """One rollout of all environments, as its policy would have made it, with advantages of unequal spread."""
    algo, generator = learner(), torch.Generator().manual_seed(2)
    rows = {
        "obs": torch.randn(STEPS, ENVS, OBS, generator=generator),
        "critic_obs": torch.randn(STEPS, ENVS, CRITIC, generator=generator),
    }
    with torch.no_grad():
        rows["value"] = algo.net.values(rows["critic_obs"])
        action, mean, log_prob = algo.sample(rows["obs"].flatten(0, 1))
    rows |= {k: v.view(STEPS, ENVS, -1) for k, v in (("action", action), ("mean", mean), ("log_prob", log_prob))}
    rows["advantage"] = torch.randn(STEPS, ENVS, 2, generator=generator) * torch.linspace(0.5, 3.0, ENVS)[:, None] + 0.3
    return {k: v.contiguous() for k, v in rows.items()}


def torchrun(folder, *argv):
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2", *map(str, argv)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-3000:]


@pytest.mark.slow
def test_two_ranks_learn_like_one_process_with_the_joined_batch(rollout, tmp_path):
    save_file(rollout, tmp_path / "rollout.safetensors")
    (tmp_path / "each_rank.py").write_text(EACH_RANK.format(tests=str(Path(__file__).parent)))
    torchrun(tmp_path, tmp_path / "each_rank.py")
    alone = learn(rollout)
    first, second = (load_file(tmp_path / f"result{r}.safetensors") for r in range(2))
    assert set(first) == set(second) == set(alone)
    for key, value in alone.items():
        assert torch.equal(first[key], second[key]), key
        torch.testing.assert_close(first[key], value, rtol=1e-5, atol=1e-6, msg=lambda m, key=key: f"{key}: {m}")
    assert any(value.abs().max() > 1e-3 for key, value in alone.items() if key.startswith("gradient."))
    for rank in range(2):  # left over, they could abort the process
        threads = json.loads((tmp_path / f"threads{rank}.json").read_text())
        assert threads and not [name for name in threads if "gloo" in name]


@pytest.mark.slow
def test_a_run_of_two_ranks_is_one_run_and_resumes_bit_for_bit(tiny, tiny_options, tmp_path):
    def train(out, updates):
        torchrun(
            tmp_path, "-m", "hotice.learn", "train", "--out", out, "--resume", "--updates", updates, *tiny_options,
            "--scenes", "open_floor", "gap",
        )  # fmt: skip

    train("whole", 2)
    train("parts", 1)
    train("parts", 2)
    (a, meta), (b, _) = (load_checkpoint(tmp_path / name) for name in ("whole", "parts"))
    assert set(a) == set(b) and [k for k in a if not torch.equal(a[k], b[k])] == []
    assert meta["ranks"] == 2 and meta["steps"] == 2 * 2 * 64
    assert not torch.equal(a["env.physics.qpos"], a["rank1.env.physics.qpos"]), "each rank has its own episodes"
    assert [json.loads(line)["update"] for line in (tmp_path / "whole" / "log.jsonl").open()] == [1, 2]


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
