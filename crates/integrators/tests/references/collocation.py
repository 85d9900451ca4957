"""Reference states of the test problems without closed form, and of the free rigid body as a check of its own.

Gauss-Legendre collocation of 10 stages (order 20) in 40 digits, on the equations in another form than the crate has them
(momenta instead of velocities, rotation matrices instead of quaternions); printed with the step and with half of it.

    python3 collocation.py           needs mpmath
"""
from mpmath import mp, mpf, matrix, cos, sin, sqrt, pi, lu_solve, nstr
import sys

mp.dps = 40
STAGES = 10


def legendre_roots(n):
    # Coefficients of the shifted Legendre polynomial, highest power first.
    coefficients = [(-1) ** (n + k) * mp.binomial(n, k) * mp.binomial(n + k, k) for k in range(n, -1, -1)]
    return sorted(mp.polyroots(coefficients, maxsteps=500, extraprec=200))


def collocation(n):
    c = legendre_roots(n)
    v = matrix(n, n)
    for i in range(n):
        for j in range(n):
            v[i, j] = c[j] ** i
    a = []
    for i in range(n):
        rhs = matrix([c[i] ** (k + 1) / (k + 1) for k in range(n)])
        a.append(list(lu_solve(v, rhs)))
    b = list(lu_solve(v, matrix([mpf(1) / (k + 1) for k in range(n)])))
    return a, b


A, B = collocation(STAGES)


def solve(f, x, end, steps):
    h = mpf(end) / steps
    x = [mpf(a) for a in x]
    n = len(x)
    k = [f(x)] * STAGES
    for _ in range(steps):
        k = [f(x)] * STAGES
        for _ in range(200):
            new = [f([x[j] + h * sum(A[i][l] * k[l][j] for l in range(STAGES)) for j in range(n)]) for i in range(STAGES)]
            change = max(abs(new[i][j] - k[i][j]) for i in range(STAGES) for j in range(n))
            k = new
            if change < mpf(10) ** -36:
                break
        x = [x[j] + h * sum(B[i] * k[i][j] for i in range(STAGES)) for j in range(n)]
    return x


def double_pendulum(x):
    # H = (p1^2 + 2 p2^2 - 2 p1 p2 c) / (2 (2 - c^2)) - 2 g cos a - g cos b; unit masses and lengths, angles from hanging
    a, b, p1, p2 = x
    g = mpf("9.81")
    c, s = cos(a - b), sin(a - b)
    d = 2 - c * c
    top = p1 * p1 + 2 * p2 * p2 - 2 * p1 * p2 * c
    by_c = -p1 * p2 / d + top * c / (d * d)
    by_a = -s * by_c
    return [(p1 - c * p2) / d, (2 * p2 - c * p1) / d, -by_a - 2 * g * sin(a), by_a - g * sin(b)]


def body(moments, weight):
    """x = R row by row, then the angular momentum in the body's axes; centre of mass on the third axis, weight = m g l."""
    def f(x):
        r, m = x[:9], x[9:]
        w = [m[i] / moments[i] for i in range(3)]
        hat = [[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]]
        dr = [sum(r[3 * i + k] * hat[k][j] for k in range(3)) for i in range(3) for j in range(3)]
        up = r[6:9]
        torque = [weight * up[1], -weight * up[0], 0]
        dm = [m[1] * w[2] - m[2] * w[1] + torque[0], m[2] * w[0] - m[0] * w[2] + torque[1], m[0] * w[1] - m[1] * w[0] + torque[2]]
        return dr + dm
    return f


def of_quaternion(q):
    w, x, y, z = q
    return [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
            2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
            2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]


def to_quaternion(r):
    w = sqrt(1 + r[0] + r[4] + r[8]) / 2
    return [w, (r[7] - r[5]) / (4 * w), (r[2] - r[6]) / (4 * w), (r[3] - r[1]) / (4 * w)]


def show(name, values):
    print(name, [nstr(v, 22) for v in values], flush=True)


for steps in (120, 240):
    a, b, p1, p2 = solve(double_pendulum, [1, mpf("1.5"), 0, 0], 3, steps)
    c = cos(a - b)
    d = 2 - c * c
    show("double pendulum, t = 3, %d steps:" % steps, [a, b, (p1 - c * p2) / d, (2 * p2 - c * p1) / d])

for steps in (120, 240):
    moments = [1, mpf("1.5"), 2]
    theta = mpf("0.5")
    q = [cos(theta / 2), sin(theta / 2), 0, 0]
    spin = [mpf("0.3"), mpf("-0.2"), 4]
    x = solve(body(moments, mpf("5")), of_quaternion(q) + [i * w for i, w in zip(moments, spin)], 2, steps)
    show("heavy top, t = 2, %d steps:" % steps, to_quaternion(x[:9]) + [x[9 + i] / moments[i] for i in range(3)])

for steps in (160, 320):
    moments = [1, 2, 3]
    spin = [1, 0, mpf("1.2")]
    lx, lz = mpf(1), 3 * spin[2]
    # Turned about y until the angular momentum stands on z: the body's axis 1 goes down, by Euler's angles z-x-z with psi = pi/2.
    size = sqrt(lx * lx + lz * lz)
    half = mp.acos(lz / size) / 2
    q = [cos(half) * cos(pi / 4), sin(half) * cos(pi / 4), -sin(half) * sin(pi / 4), cos(half) * sin(pi / 4)]
    x = solve(body(moments, 0), of_quaternion(q) + [i * w for i, w in zip(moments, spin)], 5, steps)
    show("rigid body, t = 5, %d steps:" % steps, to_quaternion(x[:9]) + [x[9 + i] / moments[i] for i in range(3)])
    show("    start", q)
