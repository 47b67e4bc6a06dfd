"""Caches of their own for tests."""

import os

import pytest

from hotice.caches import cache_root


@pytest.fixture(autouse=True, scope="session")
def caches(tmp_path_factory):
    """No test reads what another run left."""
    with pytest.MonkeyPatch.context() as patch:
        # compiled functions stay where they are
        patch.setenv("NUMBA_CACHE_DIR", os.environ.get("NUMBA_CACHE_DIR") or str(cache_root().parent))
        patch.setenv("HOTICE_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield
