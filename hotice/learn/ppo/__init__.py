"""Dual-agent PPO: networks, storage, advantages, losses, update (paper, section IV-B)."""
