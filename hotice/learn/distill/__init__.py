"""Distillation of teachers into one student: DAgger, labels, configuration (paper, section IV-C)."""
