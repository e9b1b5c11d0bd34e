"""Writes `efforts.json`: efforts of least squares for torques, by the quadratic programs of quadprog.

    pip install quadprog==0.1.14 numpy
    python efforts.py [--cases N] > efforts.json

minimises sum((f - bias)^2) with P f = torque and low <= f <= high. Units are SI.
"""

import argparse
import json

import numpy as np
import quadprog

SYMMETRIC = np.array([
    [0.0127, -0.0127, 0, 0, 0, 0, 0, 0],
    [0, 0, 0.0127, -0.0127, 0.0095, -0.0095, 0.008, -0.008],
    [0, 0, 0, 0, 0.0095, -0.0095, 0.008, -0.008],
    [0, 0, 0, 0, 0, 0, 0.008, -0.008],
])
ASYMMETRIC = SYMMETRIC.copy()
ASYMMETRIC[1, 6:] = [0.006, -0.0085]
ASYMMETRIC[2, 6:] = [0.008, 0.003]


def case(number, random):
    arms = [SYMMETRIC, ASYMMETRIC][number % 2]
    low, high = np.full(8, 4.0), np.full(8, 130.0)
    bias = np.full(8, [4.0, 7.0, 30.0][number // 2 % 3])
    if number // 6 % 2:
        low, high = random.uniform(0, 10, 8), random.uniform(50, 200, 8)
        bias = low + random.uniform(0, 1, 8) ** 2 * (high - low)
    # Efforts that differ from the preferred ones a little, or much.
    spread = [0.05, 0.5, 1.0][number // 12 % 3]
    efforts = np.clip(bias + spread * (random.uniform(low, high) - bias), low, high)
    torque = arms @ efforts
    # Rows of the size of one; the equalities come first.
    scale = 1 / np.linalg.norm(arms, axis=1)
    equal = arms * scale[:, None]
    conditions = np.vstack([equal, np.eye(8), -np.eye(8)]).T
    bounds = np.concatenate([torque * scale, low, -high])
    found, *_ = quadprog.solve_qp(np.eye(8), bias, conditions, bounds, meq=4)
    return {
        "arms": ["sym", "asym"][number % 2],
        "low": low.tolist(),
        "high": high.tolist(),
        "bias": bias.tolist(),
        "torque": torque.tolist(),
        "objective": float(np.sum((found - bias) ** 2)),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=216)
    cases = parser.parse_args().cases
    random = np.random.default_rng(977)
    print('{"cases": [')
    print(",\n".join(json.dumps(case(number, random)) for number in range(cases)))
    print("]}")


main()
