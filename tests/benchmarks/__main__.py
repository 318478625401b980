"""Run every benchmark of this package: `python -m tests.benchmarks`."""

from importlib import import_module
from pkgutil import iter_modules

from tests import benchmarks

for module in sorted(found.name for found in iter_modules(benchmarks.__path__)):
    if module != "__main__":
        import_module(f"{benchmarks.__name__}.{module}").main()
