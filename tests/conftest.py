"""Shared fixtures."""

from pathlib import Path

import pytest

from hil.threads import use_one_blas_thread

use_one_blas_thread()  # as every session does

RECORDINGS = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def recordings() -> Path:
    """Folder of real recordings; tests that use it carry the mark ``data``."""
    if not RECORDINGS.is_dir():
        pytest.skip("the recordings are not beside this checkout (../shared/data)")
    return RECORDINGS
