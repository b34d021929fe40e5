#!/usr/bin/env python3
"""Motions of the simulated plants by other integrators than theirs; tests/unit/plant_reference_test.cc compares.

    python3 tests/reference/plants.py DIRECTORY      writes the tables (CSV, SI units); needs the standard library only

Each table holds the state at the ticks; the case and its numbers are in the function that makes it.
"""

import math
import pathlib
import sys


def add(y, h, f):
    return [a + h * b for a, b in zip(y, f)]


def runge_kutta(f, t, y, h):
    a = f(t, y)
    b = f(t + h / 2, add(y, h / 2, a))
    c = f(t + h / 2, add(y, h / 2, b))
    d = f(t + h, add(y, h, c))
    return [y[i] + h / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]) for i in range(len(y))]


def extrapolated(f, y, h, columns=9):
    """One step by the modified midpoint rule, extrapolated (Gragg, Bulirsch, Stoer), for an autonomous f."""
    table = []
    for j in range(columns):
        n = 2 * (j + 1)
        step = h / n
        before, now = y, add(y, step, f(y))
        for _ in range(n - 1):
            before, now = now, add(before, 2 * step, f(now))
        row = [add([0.5 * (a + b) for a, b in zip(before, now)], 0.5 * step, f(now))]
        for k in range(j):
            factor = ((j + 1) / (j - k)) ** 2 - 1
            row.append([a + (a - b) / factor for a, b in zip(row[k], table[j - 1][k])])
        table.append(row)
    return table[-1][-1]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def turned(q, v):
    """v in body axes, from world axes, for an attitude q = (w, x, y, z)."""
    u = [-q[1], -q[2], -q[3]]
    t = [2 * c for c in cross(u, v)]
    c = cross(u, t)
    return [v[i] + q[0] * t[i] + c[i] for i in range(3)]


def tumbling():
    """A free body at 40 rad/s, mostly about its middle axis, 20 s at 100 Hz: t, attitude (w, x, y, z)."""
    inertia = [1e-3, 2e-3, 2.5e-3]
    momentum = [inertia[i] * w for i, w in enumerate([2.0, 39.9, 2.0])]

    def rate(q):
        w = [m / j for m, j in zip(turned(q, momentum), inertia)]
        return [-0.5 * (q[1] * w[0] + q[2] * w[1] + q[3] * w[2]),
                0.5 * (q[0] * w[0] + q[2] * w[2] - q[3] * w[1]),
                0.5 * (q[0] * w[1] + q[3] * w[0] - q[1] * w[2]),
                0.5 * (q[0] * w[2] + q[1] * w[1] - q[2] * w[0])]

    q, rows = [1.0, 0.0, 0.0, 0.0], []
    for k in range(1, 2001):
        for _ in range(2):
            q = extrapolated(rate, q, 0.005)
        norm = math.sqrt(sum(c * c for c in q))
        q = [c / norm for c in q]
        if k % 100 == 0:
            rows.append([k * 0.01] + q)
    return rows


def rough_impact():
    """10 g, μ = 0.8, thrown aslant onto 5 kN/m and pressed with 20 N and pulled along by a force that changes every
    tick, 1 kHz: t, x, z, v_x, v_z."""
    mass, stiffness, damping, mu, v_s = 0.01, 5000.0, 5.0, 0.8, 1e-3
    y, rows, t = [0.0, 0.0005, 0.3, -0.4], [], 0.0  # t is of no account: the force is held
    h = 5e-8
    for k in range(20):
        along = 25.0 * math.sin(0.9 * k)

        def rate(_, s):
            normal = max(0.0, -stiffness * s[1] - damping * s[3]) if inside and s[1] < 0 else 0.0
            friction = -mu * normal * s[2] / max(abs(s[2]), v_s)
            return [s[2], s[3], (along + friction) / mass, (-20.0 + normal) / mass]

        left = 1e-3
        while left > 1e-15:
            step, inside = min(h, left), y[1] < 0
            there = runge_kutta(rate, t, y, step)
            if y[1] >= 0 > there[1]:  # contact begins with a jump of force, at the end of a step
                lo, hi = 0.0, step
                while hi - lo > 1e-20:
                    mid = 0.5 * (lo + hi)
                    if lo == mid or hi == mid:
                        break
                    if runge_kutta(rate, t, y, mid)[1] >= 0:
                        lo = mid
                    else:
                        hi = mid
                step = hi
                there = runge_kutta(rate, t, y, step)
            y = there
            left -= step
        rows.append([(k + 1) * 1e-3] + y)
    return rows


def load_1(t):
    return 0.6 * math.sin(2 * math.pi * 40 * t) + 0.2 * math.sin(2 * math.pi * 93 * t)


def handle_on_a_line():
    """A handle of 0.095 kg with a hand's 300 N/m and 1 N s/m and Coulomb friction of 0.3 N, under a load that is linear
    in time within each tick of 1 ms: t, x, v. Its equation is solved in closed form between stops and releases, which
    are found by bisection."""
    mass, damping, stiffness, coulomb = 0.095, 1.0, 300.0, 0.3
    sigma = damping / (2 * mass)
    omega = math.sqrt(stiffness / mass - sigma * sigma)

    def slide(x, v, u, w, sign, t):
        # Particular solution x = a + b t.
        b = w / stiffness
        a = (u - sign * coulomb - damping * b) / stiffness
        c, e = x - a, math.exp(-sigma * t)
        d = (v - b + sigma * c) / omega
        cos, sin = math.cos(omega * t), math.sin(omega * t)
        return (a + b * t + e * (c * cos + d * sin),
                b + e * ((d * omega - sigma * c) * cos - (c * omega + sigma * d) * sin))

    x, v, rows, parts = 0.0, 0.0, [], 2000
    for k in range(200):
        u0 = load_1(k * 1e-3)
        w = (load_1((k + 1) * 1e-3) - u0) / 1e-3
        t, sign = 0.0, 0
        if v != 0.0:
            sign = math.copysign(1, v)
        while t < 1e-3:
            left = 1e-3 - t
            u = u0 + w * t
            if sign == 0:
                pull = u - stiffness * x
                if abs(pull) > coulomb:
                    sign = math.copysign(1, pull)
                else:
                    wait = max((s * coulomb - pull) / w if w != 0 else math.inf for s in (1, -1))
                    if wait >= left:
                        break
                    t += wait
                    sign = math.copysign(1, w)
                continue
            end = None
            for i in range(1, parts + 1):
                if sign * slide(x, v, u, w, sign, left * i / parts)[1] < 0 and (v != 0.0 or i > 1):
                    lo, hi = left * (i - 1) / parts, left * i / parts
                    for _ in range(60):
                        mid = 0.5 * (lo + hi)
                        if sign * slide(x, v, u, w, sign, mid)[1] > 0:
                            lo = mid
                        else:
                            hi = mid
                    end = hi
                    break
            x, v = slide(x, v, u, w, sign, left if end is None else end)
            t += left if end is None else end
            if end is not None:
                v, sign = 0.0, 0
        rows.append([(k + 1) * 1e-3, x, v])
    return rows


def load_3(t):
    return [0.08 * math.sin(2 * math.pi * 9 * t), 0.07 * math.sin(2 * math.pi * 7 * t + 1.0), 0.05 * math.cos(30 * t)]


def handle_in_space():
    """A handle of 0.075 kg with 0.02 N s/m, Coulomb friction of 0.04 N and 20 N/m under a load that is linear in time
    within each tick of 1 ms, in three axes, from 0.1 m/s: t, x, v. Runge-Kutta steps short against the turning of the
    direction, which is ever faster towards a stop and after a release."""
    mass, damping, stiffness, coulomb = 0.075, 0.02, 20.0, 0.04
    y, rows = [0.0, 0.0, 0.0, 0.1, 0.0, 0.02], []
    rest = 1e-10
    for k in range(300):
        u0, u1 = load_3(k * 1e-3), load_3((k + 1) * 1e-3)
        w = [(b - a) / 1e-3 for a, b in zip(u0, u1)]

        def load(t, s):
            return [u0[i] + w[i] * t - stiffness * s[i] for i in range(3)]

        def rate(t, s):
            pull, speed = load(t, s), math.sqrt(s[3] * s[3] + s[4] * s[4] + s[5] * s[5])
            return s[3:] + [(pull[i] - (damping + coulomb / speed) * s[3 + i]) / mass for i in range(3)]

        t = 0.0
        while t < 1e-3 - 1e-15:
            speed = math.sqrt(sum(c * c for c in y[3:]))
            if speed < rest:
                y[3:] = [0.0, 0.0, 0.0]
                pull = load(t, y)
                a, b = sum(c * c for c in w), sum(p * c for p, c in zip(pull, w))
                c = sum(p * p for p in pull) - coulomb * coulomb
                wait = 0.0 if c > 0 else (-b + math.sqrt(b * b - a * c)) / a
                if wait >= 1e-3 - t:
                    break
                # Begins along the load; by so little that it does not turn.
                start = min(1e-7, 1e-3 - t - wait)
                t += wait + start
                pull = load(t, y)
                size = math.sqrt(sum(p * p for p in pull))
                push = 0.5 * (size - coulomb) if c <= 0 else size - coulomb
                y[3:] = [push * start / mass * p / size for p in pull]
                continue
            h = min(1e-3 - t, 2e-5, 0.05 * mass * speed / coulomb)
            y = runge_kutta(rate, t, y, h)
            t += h
        rows.append([(k + 1) * 1e-3] + y)
    return rows


def main():
    folder = pathlib.Path(sys.argv[1])
    for make, columns in ((tumbling, "t_s,q_w,q_x,q_y,q_z"), (rough_impact, "t_s,x,z,v_x,v_z"),
                          (handle_on_a_line, "t_s,x,v"), (handle_in_space, "t_s,x,y,z,v_x,v_y,v_z")):
        with open(folder / f"{make.__name__}.csv", "w", encoding="ascii") as out:
            out.write(columns + "\n")
            for row in make():
                out.write(",".join(repr(float(c)) for c in row) + "\n")


if __name__ == "__main__":
    main()
