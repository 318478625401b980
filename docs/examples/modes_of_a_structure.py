"""Modes of any structure from its free decays: here a frame of three storeys, struck twice.

`identify_modes` takes a list of arrays, (n_samples, n_channels), evenly sampled, with the same
channels in each; lengths and units may differ.  Nothing is assumed of the structure.
"""

import numpy as np

import identify

RATE_HZ = 200.0
MASS_KG, STIFFNESS_N_M, DAMPING_S = 1000.0, 2e6, 6e-4  # of a storey; C = DAMPING_S * K

# The truth, which `identify_modes` does not see: M x'' + C x' + K x = 0.
K = STIFFNESS_N_M * np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
model = np.block([[np.zeros((3, 3)), np.eye(3)], [-K / MASS_KG, -DAMPING_S * K / MASS_KG]])

# Two blows, on the top and on the first storey; 4 s of the three accelerations with 1 % noise.
rng = np.random.default_rng(1)
poles, vectors = np.linalg.eig(model)
step = (vectors * np.exp(poles / RATE_HZ) @ np.linalg.inv(vectors)).real
records = []
for storey in (2, 0):
    state = np.zeros(6)
    state[3 + storey] = 0.1  # m/s
    motion = []
    for _ in range(int(4.0 * RATE_HZ)):
        motion.append((model @ state)[3:])
        state = step @ state
    clean = np.array(motion)
    records.append(clean + 0.01 * clean.std() * rng.standard_normal(clean.shape))

modal = identify.identify_modes(records, RATE_HZ)

truth = sorted((abs(p) / (2 * np.pi), -p.real / abs(p)) for p in poles if p.imag > 0)
print("   found: Hz, damping       truth: Hz, damping    shape")
for f, d, shape, (f0, d0) in zip(
    modal.frequencies_hz, modal.damping_ratios, modal.shapes.T, truth, strict=True
):
    relative = (shape / shape[np.argmax(abs(shape))]).real
    print(f"{f:10.4f} {100 * d:6.3f} %  {f0:10.4f} {100 * d0:6.3f} %   ", np.round(relative, 3))
