"""Times JAX on the problem of `benches/training.rs`: jax_training.py [float32|float64] [THREADS] [ROUNDS].

Prints one line of JSON, in ms of the clock on the wall, the least of the rounds: `step`, a call of one compiled training step on a batch that is
there already; `step_in_loop`, a step of an epoch that is one compiled loop, JAX's fastest way; `epoch` of 24,271 windows, by such a loop;
`roll_outs`, 1000 of 30 steps. Needs `pip install jax==0.10.2 optax`.
"""
import json
import math
import os
import sys
import time

DTYPE = sys.argv[1] if len(sys.argv) > 1 else "float32"
THREADS = int(sys.argv[2]) if len(sys.argv) > 2 else 1
ROUNDS = int(sys.argv[3]) if len(sys.argv) > 3 else 7

# Before JAX is loaded: it counts the processors once.
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:THREADS])
os.environ["JAX_PLATFORMS"] = "cpu"
os.environ["XLA_FLAGS"] = f"--xla_cpu_multi_thread_eigen={str(THREADS > 1).lower()}"

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy  # noqa: E402
import optax  # noqa: E402

jax.config.update("jax_enable_x64", DTYPE == "float64")

# Table 2: cart, rod and ball, kg; length, m; gravity, m/s²; friction of the pole, N·m·s/rad.
CART, ROD, BALL, LENGTH, GRAVITY, FRICTION = 0.466, 0.06, 0.012, 0.201, 9.81, 0.0020
TOTAL = CART + ROD + BALL
MOMENT = (ROD / 2 + BALL) * LENGTH
INERTIA = (ROD / 3 + BALL) * LENGTH**2
SIZES = (5, 50, 50, 50, 1)
WINDOWS, BATCH, STEP = 24_271, 128, 0.02
LARGEST = 5.0  # of the network's force, N


def network(layers, features):
    *hidden, (weights, biases) = layers
    for w, b in hidden:
        features = jnp.maximum(features @ w + b, 0)
    return jnp.tanh(features @ weights + biases)


def rate(layers, state, force):
    _, angle, speed, turning = state
    sine, cosine = jnp.sin(angle), jnp.cos(angle)
    seen = jnp.stack((cosine, sine, speed, turning, force), axis=-1)
    on_cart = LARGEST * network(layers, seen)[:, 0] + MOMENT * sine * turning**2
    on_pole = MOMENT * GRAVITY * sine - FRICTION * turning
    coupling = MOMENT * cosine
    determinant = TOTAL * INERTIA - coupling**2
    return jnp.stack(
        (
            speed,
            turning,
            (INERTIA * on_cart - coupling * on_pole) / determinant,
            (TOTAL * on_pole - coupling * on_cart) / determinant,
        )
    )


def advanced(layers, state, force):
    first = rate(layers, state, force)
    second = rate(layers, state + STEP / 2 * first, force)
    third = rate(layers, state + STEP / 2 * second, force)
    fourth = rate(layers, state + STEP * third, force)
    return state + STEP / 6 * (first + 2 * (second + third) + fourth)


def loss(layers, state, force, after):
    x, angle, *speeds = advanced(layers, state, force)
    x_after, angle_after, *speeds_after = after
    squares = (x - x_after) ** 2 + 4 * jnp.sin((angle - angle_after) / 2) ** 2
    return jnp.mean(squares + sum((a - b) ** 2 for a, b in zip(speeds, speeds_after)))


random = numpy.random.default_rng(1)


def uniform(size, *shape):
    return jnp.asarray(random.uniform(-size, size, shape), DTYPE)


states = jnp.stack([uniform(size, WINDOWS) for size in (0.3, math.pi, 0.5, 7.0)])
forces = uniform(4.0, WINDOWS)
layers = [(uniform(math.sqrt(6 / (m + n)), m, n), jnp.zeros(n, DTYPE)) for m, n in zip(SIZES, SIZES[1:])]
# What another network would have done.
teacher = [(uniform(math.sqrt(6 / (m + n)), m, n), jnp.zeros(n, DTYPE)) for m, n in zip(SIZES, SIZES[1:])]
targets = jax.jit(advanced)(teacher, states, forces)


def gathered(batch, states, forces, targets):
    return states[:, batch], forces[batch], targets[:, batch]


adam = optax.adam(1e-3)


def learnt(training, states, forces, targets):
    layers, moments = training
    value, gradient = jax.value_and_grad(loss)(layers, states, forces, targets)
    change, moments = adam.update(gradient, moments)
    return (optax.apply_updates(layers, change), moments), value


one_step = jax.jit(learnt)


@jax.jit
def one_epoch(training, batches, *data):
    return jax.lax.scan(lambda training, batch: learnt(training, *gathered(batch, *data)), training, batches)


@jax.jit
def rolled_out(layers, states, forces):
    def step(state, force):
        state = advanced(layers, state, force)
        return state, state

    return jax.lax.scan(step, states, forces)[1]


def least(call, count=1):
    """ms of a call, the least of the rounds; each is `count` calls."""
    jax.block_until_ready(call(0))
    times = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        for k in range(count):
            last = call(k)
        jax.block_until_ready(last)
        times.append((time.perf_counter() - start) / count)
    return round(1e3 * min(times), 4)


whole = WINDOWS // BATCH
batches = jnp.asarray(random.permutation(WINDOWS)[: whole * BATCH].reshape(whole, BATCH))
data = (states, forces, targets)
each_batch = [gathered(batch, *data) for batch in batches]
training = (layers, adam.init(layers))
held = uniform(4.0, 30, 1000)


def next_step(k):
    global training
    training, value = one_step(training, *each_batch[k % whole])
    return value


def next_epoch(_):
    global training
    training, values = one_epoch(training, batches, *data)
    return values


figures = {"tool": "jax", "version": jax.__version__, "dtype": DTYPE, "threads": THREADS}
figures["step"] = least(next_step, 200)
loop = least(next_epoch)
figures["step_in_loop"] = round(loop / whole, 4)
figures["epoch"] = round(loop / (whole * BATCH) * WINDOWS, 2)
figures["roll_outs"] = least(lambda _: rolled_out(training[0], states[:, :1000], held))
figures["load"] = os.getloadavg()[0]
print(json.dumps(figures))
