"""Caches of their own for tests."""

import pytest


@pytest.fixture(autouse=True, scope="session")
def caches(tmp_path_factory):
    """No test reads what another run left."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HOTICE_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield
