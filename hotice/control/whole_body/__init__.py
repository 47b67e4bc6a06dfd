"""Whole-body control: dynamics terms, tasks, contacts and the quadratic program that weighs them."""
