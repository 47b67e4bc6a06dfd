"""Branches of one run: processes that train apart from the same weights and are averaged now and then."""
