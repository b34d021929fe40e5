#!/usr/bin/env python3
"""A delay x loss map of the delayed bilateral loop of one axis, all cells at once in NumPy arrays: the rival of
`twoport-lab sweep` as a user would write it in an afternoon.

The equations are those of tests/support/hand_written.h: hand and device by their exact map, two-port observer and controller at
both ends, virtual coupling, robot on an elastic wall. Of the laboratory it leaves out what makes arrays slow: the robot is
stepped by the exact map of the side of the wall where the tick begins, packets are late by whole ticks in order, and there
are no verdict, no summary and no trace.

usage: numpy_batch.py [CELLS_PER_AXIS [SECONDS]]
"""
import sys
import time

import numpy as np

T = 5e-4
HAND_M, HAND_K, HAND_B, DEVICE_M, DEVICE_B = 0.1, 400.0, 8.0, 0.075, 0.05
K, B, ROBOT_M, ROBOT_B, WALL_K, WALL_AT = 1000.0, 20.0, 0.5, 2.0, 5000.0, 0.02
E0, MAX_GAIN, ENGAGE_S, CATCH_UP = 1e-3, 10.0, 0.1, 0.05


def exact(m, b, k, h):
    """Step of m x'' = u + w t - b x' - k x from x = 0: columns for v0, u, w; by the matrix exponential's series."""
    a = np.array([[0, 1, 0, 0], [-k / m, -b / m, 1 / m, 0], [0, 0, 0, 1], [0, 0, 0, 0]]) * h
    e, term = np.eye(4), np.eye(4)
    for i in range(1, 30):
        term = term @ a / i
        e = e + term
    return e[:2, 1:]


def largest_feasible_scale(q, b, a):
    """Largest s in [0, 1] with q s^2 + b s <= a."""
    root = np.sqrt(np.maximum(0.0, b * b + 4.0 * q * a))
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.where(b <= 0.0, (root - b) / (2.0 * q), 2.0 * a / (root + b))
    return np.where(q + b <= a, 1.0, np.clip(np.nan_to_num(s), 0.0, 1.0))


def run(delay_ticks, loss, seconds, seed=1):
    """All cells for `seconds`; returns the largest |x_m|, |x_s| of each, and the last x_s."""
    n = delay_ticks.size
    hand, free, wall = (exact(HAND_M + DEVICE_M, HAND_B + DEVICE_B, HAND_K, T), exact(ROBOT_M, ROBOT_B, 0.0, T),
                        exact(ROBOT_M, ROBOT_B, WALL_K, T))
    z = lambda: np.zeros(n)
    x_m, v_m, f_m, f_b, x_b, u, d, error_bound = z(), z(), z(), z(), z(), z(), z(), z()
    x_s, v_s, f_s, x_sb, x_sd = z(), z(), z(), z(), z()
    in_m, out_m, in_s, out_s, created, worst, credit, ramp = z(), z(), z(), z(), z(), z(), z(), z()
    target, rx_v, rx_in_m, rx_f, rx_in_s = z(), z(), z(), z(), z()
    ring = int(delay_ticks.max()) + 1
    to_slave, to_master = np.zeros((ring, 4, n)), np.zeros((ring, 3, n))  # x, v, in, arrives; f, in, arrives
    cell, random = np.arange(n), np.random.default_rng(seed)
    give, g = 0.5 * T / DEVICE_M, 1.0 / (B + K * T)
    heard_m = heard_s = np.zeros(n, bool)
    far, x_h = z(), 0.0
    for k in range(int(round(seconds / T))):
        s = min(1.0, (k + 1) * T)
        x_h_next = 0.03 * s**3 * (10 - s * (15 - 6 * s))
        slot, due = k % ring, (k - delay_ticks) % ring
        old = k >= delay_ticks
        # Master: book, predict, receive, bound.
        moved = x_m - x_b
        e = f_m * moved
        in_m += np.maximum(e, 0)
        out_m += np.maximum(-e, 0)
        if k > 0:
            expected = u + d - give * (f_b + f_m)
            err = moved / T - expected
            u, d, error_bound = expected + 0.75 * err, d + 0.25 * err, np.maximum(np.abs(err), 0.95 * error_bound)
        f_b, x_b = f_m, x_m
        m = to_master[due, :, cell]
        got = old & (m[:, 2] > 0)
        rx_f, rx_in_s, heard_m = np.where(got, m[:, 0], rx_f), np.where(got, np.maximum(m[:, 1], rx_in_s), rx_in_s), heard_m | got
        ramp = np.where(heard_m, np.minimum(1.0, ramp + T / ENGAGE_S), 0.0)
        f_d = ramp * rx_f
        f2, w = f_d * f_d, u + d - give * f_m
        power = f_d * w - np.abs(f_d) * error_bound
        kept = np.maximum(0.0, np.minimum(np.maximum(e, 0), out_m - (E0 + rx_in_s)))
        in_m -= kept
        out_m -= kept
        left = E0 + np.minimum(rx_in_s, in_m) - out_m
        with np.errstate(divide="ignore", invalid="ignore"):
            cap = np.nan_to_num(MAX_GAIN * T * power * power / f2)
        repaid = np.where((left < 0) & (power > 0), np.minimum(-left, cap), 0.0)
        f = largest_feasible_scale(give * f2, -power, (np.maximum(left, 0) - repaid) / T) * f_d
        # Slave: receive, couple, bound.
        created -= f_s * (x_s - x_sb)
        x_sb = x_s
        m = to_slave[due, :, cell]
        got = old & (m[:, 3] > 0)
        rx_v, rx_in_m, heard_s = np.where(got, m[:, 1], rx_v), np.where(got, np.maximum(m[:, 2], rx_in_m), rx_in_m), heard_s | got
        target = np.where(got, m[:, 0], target + T * rx_v)
        v = rx_v + np.clip((target - x_sd) / T - rx_v, -CATCH_UP, CATCH_UP)
        f_ds = np.where(heard_s, K * (x_sd + T * v - x_s) + B * (rx_v - v_s), 0.0)
        p, q = f_ds * v, g * f_ds * f_ds
        a = np.maximum(E0 + rx_in_m - out_s, 0) / T
        cut = np.where(p <= a, 1.0, largest_feasible_scale(q, p - q, a))
        step = np.where(heard_s, T * (v - (1 - cut) * g * f_ds), 0.0)
        f_s = cut * f_ds
        into = f_s * step
        out_s += np.maximum(into, 0)
        in_s += np.maximum(-into, 0)
        created += into
        x_sd = x_sd + step
        worst = np.minimum(worst, created)
        credit = np.maximum(credit, in_s + worst)
        # The link: what is lost never arrives.
        to_slave[slot] = x_m, v_m, in_m, random.random(n) >= loss
        to_master[slot] = f_ds, credit, random.random(n) >= 0.0
        # Plants.
        rate = (x_h_next - x_h) / T
        load, slope = HAND_K * (x_h - x_m) + HAND_B * rate - f, HAND_K * rate
        x_m, v_m = (x_m + hand[0, 0] * v_m + hand[0, 1] * load + hand[0, 2] * slope,
                    hand[1, 0] * v_m + hand[1, 1] * load + hand[1, 2] * slope)
        inside = x_s > WALL_AT
        load = f_s - np.where(inside, WALL_K * (x_s - WALL_AT), 0.0)
        x_s, v_s = (x_s + np.where(inside, wall[0, 0], free[0, 0]) * v_s + np.where(inside, wall[0, 1], free[0, 1]) * load,
                    np.where(inside, wall[1, 0], free[1, 0]) * v_s + np.where(inside, wall[1, 1], free[1, 1]) * load)
        f_m, x_h = f, x_h_next
        far = np.maximum(far, np.maximum(np.abs(x_m), np.abs(x_s)))
    return far, x_s


def main():
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 30
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 8.0
    delay, loss = np.meshgrid(np.linspace(1.0, 100.0, count), np.linspace(0.0, 0.5, count), indexing="ij")
    ticks = np.maximum(1, np.ceil(delay.ravel() * 1e-3 / T - 1e-9)).astype(int)
    start = time.perf_counter()
    far, x_s = run(ticks, loss.ravel(), seconds)
    spent = time.perf_counter() - start
    print(f"{far.size} cells of {seconds:g} s at {1 / T:g} Hz in {spent:.1f} s: {far.size / spent:.1f} cells/s; "
          f"{np.mean(far < 0.1):.3f} of them stay within 0.1 m, x_s of the first ends at {x_s[0]:.6f} m")


if __name__ == "__main__":
    main()
