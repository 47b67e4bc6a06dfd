"""Learning: dual-agent PPO, distillation, fine-tuning, checkpoints."""
