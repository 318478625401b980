"""A sensor of your own: from its data sheet to values in SI units.

A string potentiometer between body and front left wheel sends its length in tenths of a millimetre,
with a rolling counter.  It gets longer when the wheel goes down, but suspension travel counts
positive when the wheel comes up: hence `sign = -1`.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from daq.bench.config import bench_codec, load_bench
from daq.samples.mapping import map_channels
from dbc import FrameBatch

DBC = """VERSION ""
BU_: POT
BO_ 513 Pot_FL: 3 POT
 SG_ length : 0|16@1+ (0.1,0) [0|1000] "mm" Vector__XXX
 SG_ counter : 16|8@1+ (1,0) [0|255] "" Vector__XXX
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_ "GenMsgCycleTime" BO_ 513 5;
"""
BENCH = """
dbc = "pot.dbc"
[[channel]]
name = "travel_fl"
signal = "Pot_FL.length"
quantity = "suspension_travel"
corner = "FL"
sign = -1
tare = -0.250      # m, what it reads at rest, after the sign
gain_sigma = 0.003 # data sheet: 0.5 % at most
delay_s = 0.002    # data sheet: 2 ms, give or take 0.5 ms
delay_sigma_s = 0.0005
"""

with TemporaryDirectory() as folder:
    (Path(folder) / "pot.dbc").write_text(DBC, encoding="utf-8")
    (Path(folder) / "bench.toml").write_text(BENCH, encoding="utf-8")
    bench = load_bench(Path(folder) / "bench.toml")

# Frames as they would come from the bus: the string gets 30 mm shorter in 50 ms.
codec = bench_codec(bench)
n = 11
frames = FrameBatch(
    t_ns=np.arange(n) * 5_000_000,
    can_id=np.full(n, 513, np.uint32),
    flags=np.zeros(n, np.uint16),
    bus=np.zeros(n, np.uint8),
    length=np.full(n, 3, np.uint8),
    data=codec.encode("Pot_FL", {"length": np.linspace(250.0, 220.0, n), "counter": np.arange(n)}),
)

(mapped,) = map_channels(bench.channels, codec.messages, bench.dbc_name)
samples = codec.decode(frames).samples[mapped.channel.signal]
for t_ns, travel_m in zip(samples.t_ns, mapped.values(samples), strict=True):
    print(f"{t_ns * 1e-9:.3f} s  {travel_m:+.4f} m")
