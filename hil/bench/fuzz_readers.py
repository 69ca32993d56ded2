"""All readers, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from highfive.hil.bench import fuzz_files as files
from highfive.hil.bench import fuzz_page as page
from highfive.hil.bench import fuzz_systems as systems
from highfive.hil.bench.fuzz_reader import Seed
from highfive.hil.bench.fuzz_study import study_seeds
from highfive.hil.bench.fuzz_toml import toml_seeds

READERS: Mapping[str, Callable[[], list[Seed]]] = {
    "c3d": files.c3d_seeds,
    "mcap": files.mcap_seeds,
    "toml": toml_seeds,
    "safetensors": files.safetensors_seeds,
    "npz": files.npz_seeds,
    "bvh": files.bvh_seeds,
    "trc": files.trc_seeds,
    "csv": files.csv_seeds,
    "tables": files.table_seeds,
    "poses": files.json_seeds,
    "study": study_seeds,
    "xdf": files.xdf_seeds,
    "take": files.take_seeds,
    "page": page.page_seeds,
    "headset": page.headset_seeds,
    "vicon": systems.vicon_seeds,
    "qtm": systems.qtm_seeds,
    "natnet": systems.natnet_seeds,
    "lsl": systems.lsl_seeds,
    "bus": systems.bus_seeds,
}
"""Name → its sound inputs, each with what reads it."""
