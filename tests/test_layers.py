"""The method alone is light."""

import subprocess
import sys

HEAVY = "dask distributed xarray scipy matplotlib ipywidgets PIL"


def test_the_method_loads_nothing_that_only_experiments_and_pages_need():
    code = f"""
import importlib, pkgutil, sys
import vtlib
for module in pkgutil.walk_packages(vtlib.__path__, "vtlib."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
print(*{{x.split(".")[0] for x in sys.modules}} & {{*{f"{HEAVY} vtlab vtbook".split()}}})
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "\n"
