"""The compiled loop over the rounds of an explicit step, with its priority queue.

All in one file: numba's cache on disk notices changes in the file of the outer function only.
"""

from __future__ import annotations

from math import sin, sqrt

import numpy as np

from ..jit import jit
from .build import close, plain

__all__ = ["march"]

#: as in the plain loop
CLOSED = 2e-15
ITERATIONS = 30


@close
def kick(e, time, elements, row, y, P, L, D, S, F):  # type: ignore[no-untyped-def]
    """Add the impulses of element e for a time to the momenta of its nodes.

    Workspace: D (8, 3) for phi', d_i, d_i' at a point, S (12,), F (nn, 4, 3).
    """
    v, shape, slope = elements.vertices, elements.shape, elements.slope
    nn, ng, length = v.shape[1], shape.shape[0], elements.lengths[e]
    for a in range(nn):
        for i in range(4):
            for x in range(3):
                F[a, i, x] = 0.0
    for g in range(ng):
        for i in range(7):
            for x in range(3):
                D[i, x] = 0.0
        for a in range(nn):
            r, N, dN = row[v[e, a]], shape[g, a], slope[g, a] / length
            for x in range(3):
                D[0, x] += dN * y[r, x]
                for i in range(3):
                    D[1 + i, x] += N * y[r + 1 + i, x]
                    D[4 + i, x] += dN * y[r + 1 + i, x]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            shear, bend = 0.0, 0.0
            for x in range(3):
                shear += D[1 + i, x] * D[0, x]
                bend += D[1 + k, x] * D[4 + j, x] - D[1 + j, x] * D[4 + k, x]
            S[6 + i] = shear - elements.reference[e, g, i]
            S[9 + i] = 0.5 * bend - elements.reference[e, g, 3 + i]
        weight = time * length * elements.weights[g]
        for i in range(6):
            total = 0.0
            for j in range(6):
                total += elements.stiffness[e, i, j] * S[6 + j]
            S[i] = weight * total
        for a in range(nn):
            N, dN = shape[g, a], slope[g, a] / length
            for x in range(3):
                for i in range(3):
                    j, k = (i + 1) % 3, (i + 2) % 3
                    F[a, 0, x] += dN * S[i] * D[1 + i, x]
                    F[a, 1 + i, x] += N * S[i] * D[0, x]
                    half = 0.5 * S[3 + i]
                    F[a, 1 + k, x] += half * (N * D[4 + j, x] - dN * D[1 + j, x])
                    F[a, 1 + j, x] += half * (dN * D[1 + k, x] - N * D[4 + k, x])
    for a in range(nn):
        n, r = v[e, a], row[v[e, a]]
        for x in range(3):
            y1, z1 = (x + 1) % 3, (x + 2) % 3
            P[n, x] -= F[a, 0, x]
            for i in range(1, 4):
                L[n, x] -= y[r + i, y1] * F[a, i, z1] - y[r + i, z1] * F[a, i, y1]


@plain
def _factors(a):  # type: ignore[no-untyped-def]
    """``sin(x)/x`` and ``(1 - cos(x))/x^2`` of ``a = x^2``, to rounding; series are faster."""
    if a < 0.0625:
        first = 1 - a / 156
        first = 1 - a / 6 * (1 - a / 20 * (1 - a / 42 * (1 - a / 72 * (1 - a / 110 * first))))
        second = 1 - a / 182
        second = 1 - a / 12 * (1 - a / 30 * (1 - a / 56 * (1 - a / 90 * (1 - a / 132 * second))))
        return first, 0.5 * second
    angle = sqrt(a)
    half = sin(0.5 * angle) / (0.5 * angle)
    return sin(angle) / angle, 0.5 * half * half


@plain
def _turn(A, p, q, angle):  # type: ignore[no-untyped-def]
    """Turn axis p towards axis q."""
    first, second = _factors(angle * angle)
    c, s = 1 - angle * angle * second, angle * first
    for x in range(3):
        a, b = A[p, x], A[q, x]
        A[p, x] = c * a + s * b
        A[q, x] = c * b - s * a


@plain
def _second(A, spin, rest):  # type: ignore[no-untyped-def]
    """The part of the turn that no symmetric top does."""
    _turn(A, 2, 0, rest * (A[1, 0] * spin[0] + A[1, 1] * spin[1] + A[1, 2] * spin[2]))


@close
def drift(v, dt, bodies, y, P, L, A, w):  # type: ignore[no-untyped-def]
    """Move node v as a free rigid body for a time dt; workspace A (3, 3), w (6,)."""
    r, mass = bodies.row[v], bodies.mass[v]
    if bodies.framed[v] == 0:
        for x in range(3):
            y[r, x] += dt / mass * P[v, x]
        return
    Q, inverse, centre = bodies.axes, bodies.inverse, bodies.centre
    for x in range(3):
        offset = 0.0
        for i in range(3):
            offset += centre[v, i] * y[r + 1 + i, x]
            A[i, x] = 0.0
            for k in range(3):
                A[i, x] += Q[v, i, k] * y[r + 1 + k, x]
        w[x] = offset
    for x in range(3):
        j, k = (x + 1) % 3, (x + 2) % 3
        w[3 + x] = L[v, x] - (w[j] * P[v, k] - w[k] * P[v, j])
    spin = w[3:6]
    rest = 0.5 * dt * (inverse[v, 1] - inverse[v, 0])
    if rest != 0.0:
        _second(A, spin, rest)
    along = A[2, 0] * spin[0] + A[2, 1] * spin[1] + A[2, 2] * spin[2]
    _turn(A, 0, 1, dt * (inverse[v, 2] - inverse[v, 0]) * along)
    factor = dt * inverse[v, 0]
    s0, s1, s2 = factor * spin[0], factor * spin[1], factor * spin[2]
    first, second = _factors(s0 * s0 + s1 * s1 + s2 * s2)
    for i in range(3):
        a0, a1, a2 = A[i, 0], A[i, 1], A[i, 2]
        b0, b1, b2 = s1 * a2 - s2 * a1, s2 * a0 - s0 * a2, s0 * a1 - s1 * a0
        A[i, 0] = a0 + first * b0 + second * (s1 * b2 - s2 * b1)
        A[i, 1] = a1 + first * b1 + second * (s2 * b0 - s0 * b2)
        A[i, 2] = a2 + first * b2 + second * (s0 * b1 - s1 * b0)
    if rest != 0.0:
        _second(A, spin, rest)
    for x in range(3):
        before = w[x]
        for k in range(3):
            y[r + 1 + k, x] = Q[v, 0, k] * A[0, x] + Q[v, 1, k] * A[1, x] + Q[v, 2, k] * A[2, x]
        offset = 0.0
        for i in range(3):
            offset += centre[v, i] * y[r + 1 + i, x]
        w[x] = offset
        y[r, x] += before - offset + dt / mass * P[v, x]
    for x in range(3):
        j, k = (x + 1) % 3, (x + 2) % 3
        L[v, x] = w[3 + x] + w[j] * P[v, k] - w[k] * P[v, j]


@plain
def _gaps(c, joints, y, gaps):  # type: ignore[no-untyped-def]
    """Gaps of the joints of a cluster; the largest one by the sizes of their terms."""
    start, stop = joints.row_start[c], joints.row_start[c + 1]
    for k in range(stop - start):
        gaps[k] = -joints.constant[start + k]
    for t in range(joints.product_start[c], joints.product_start[c + 1]):
        a, b = joints.a[t], joints.b[t]
        dot = y[a, 0] * y[b, 0] + y[a, 1] * y[b, 1] + y[a, 2] * y[b, 2]
        gaps[joints.product[t]] += joints.factor[t] * dot
    for t in range(joints.linear_start[c], joints.linear_start[c + 1]):
        for x in range(3):
            gaps[joints.linear[t] + x] += joints.linear_factor[t] * y[joints.c[t], x]
    largest = 0.0
    for k in range(stop - start):
        largest = max(largest, abs(gaps[k]) / joints.size[start + k])
        if gaps[k] != gaps[k]:
            return np.inf
    return largest


@plain
def _gradient_at(k, row, factor, x, value, joints, y, G):  # type: ignore[no-untyped-def]
    """Add ``factor value`` at component x of a row of y to the gradient of gap k."""
    n = joints.local[row]
    if n < 0:
        return
    if joints.component[row] == 0:
        G[k, n, x] += factor * value
        return
    j, i = (x + 1) % 3, (x + 2) % 3  # d x f with f along x: components x + 1 and x + 2
    G[k, n, 3 + j] += factor * value * y[row, i]
    G[k, n, 3 + i] -= factor * value * y[row, j]


@plain
def _gradients(c, joints, y, G):  # type: ignore[no-untyped-def]
    """Gradients (m, k, 6) of the gaps of a cluster by positions and turns of its nodes."""
    m = joints.row_start[c + 1] - joints.row_start[c]
    for k in range(m):
        for n in range(joints.vertex_start[c + 1] - joints.vertex_start[c]):
            for x in range(6):
                G[k, n, x] = 0.0
    for t in range(joints.product_start[c], joints.product_start[c + 1]):
        k, a, b, f = joints.product[t], joints.a[t], joints.b[t], joints.factor[t]
        for x in range(3):
            _gradient_at(k, a, f, x, y[b, x], joints, y, G)
            _gradient_at(k, b, f, x, y[a, x], joints, y, G)
    for t in range(joints.linear_start[c], joints.linear_start[c + 1]):
        for x in range(3):
            _gradient_at(
                joints.linear[t] + x, joints.c[t], joints.linear_factor[t], x, 1.0, joints, y, G
            )


@plain
def _twist(v, impulse, bodies, y, out):  # type: ignore[no-untyped-def]
    """Velocity and angular velocity (6,) of node v by an impulse and a moment (6,)."""
    r, mass = bodies.row[v], bodies.mass[v]
    for x in range(3):
        out[x], out[3 + x] = impulse[x] / mass, 0.0
    if bodies.framed[v] == 0:
        return
    c0, c1, c2 = 0.0, 0.0, 0.0
    for i in range(3):
        f = bodies.centre[v, i]
        c0 += f * y[r + 1 + i, 0]
        c1 += f * y[r + 1 + i, 1]
        c2 += f * y[r + 1 + i, 2]
    s0 = impulse[3] - (c1 * impulse[2] - c2 * impulse[1])
    s1 = impulse[4] - (c2 * impulse[0] - c0 * impulse[2])
    s2 = impulse[5] - (c0 * impulse[1] - c1 * impulse[0])
    for i in range(3):
        a0, a1, a2 = 0.0, 0.0, 0.0
        for k in range(3):
            q = bodies.axes[v, i, k]
            a0 += q * y[r + 1 + k, 0]
            a1 += q * y[r + 1 + k, 1]
            a2 += q * y[r + 1 + k, 2]
        own = bodies.inverse[v, i] * (a0 * s0 + a1 * s1 + a2 * s2)
        out[3] += own * a0
        out[4] += own * a1
        out[5] += own * a2
    out[0] += c1 * out[5] - c2 * out[4]
    out[1] += c2 * out[3] - c0 * out[5]
    out[2] += c0 * out[4] - c1 * out[3]


@plain
def _factored(c, bodies, joints, y, G, S, out):  # type: ignore[no-untyped-def]
    """Cholesky factor of the rates of the gaps by impulses on them; False if there is none."""
    m, start = joints.row_start[c + 1] - joints.row_start[c], joints.vertex_start[c]
    for i in range(m):
        for j in range(m):
            S[i, j] = 0.0
    for n in range(joints.vertex_start[c + 1] - start):
        for i in range(m):
            _twist(joints.vertices[start + n], G[i, n], bodies, y, out)
            for j in range(i + 1):
                for x in range(6):
                    S[i, j] += out[x] * G[j, n, x]
    for i in range(m):
        for j in range(i + 1):
            total = S[i, j]
            for k in range(j):
                total -= S[i, k] * S[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                S[i, i] = sqrt(total)
            else:
                S[i, j] = total / S[j, j]
    return True


@plain
def _solve(m, S, b):  # type: ignore[no-untyped-def]
    """Solve in place with a Cholesky factor."""
    for i in range(m):
        for k in range(i):
            b[i] -= S[i, k] * b[k]
        b[i] /= S[i, i]
    for i in range(m - 1, -1, -1):
        for k in range(i + 1, m):
            b[i] -= S[k, i] * b[k]
        b[i] /= S[i, i]


@plain
def drift_joined(c, dt, bodies, joints, y, P, L, A, w, G, S, gaps, impulse, saved):  # type: ignore[no-untyped-def]
    """Move a cluster for a time dt so that its joints are closed at the end.

    Gives the iterations, or less than zero if they fail. Workspace beside that of :func:`drift`:
    G (m, k, 6), S (m, m), gaps, impulse (m,), saved (k, 6, 3).
    """
    first, m = joints.vertex_start[c], joints.row_start[c + 1] - joints.row_start[c]
    count = joints.vertex_start[c + 1] - first
    _gradients(c, joints, y, G)
    if not _factored(c, bodies, joints, y, G, S, w):
        return -1, np.inf
    for n in range(count):
        v = joints.vertices[first + n]
        for x in range(3):
            saved[n, 4, x], saved[n, 5, x] = P[v, x], L[v, x]
            for i in range(1 + 3 * bodies.framed[v]):
                saved[n, i, x] = y[bodies.row[v] + i, x]
    for k in range(m):
        impulse[k] = 0.0
    last = np.inf
    for iteration in range(1, ITERATIONS + 1):
        for n in range(count):
            v = joints.vertices[first + n]
            for x in range(3):
                P[v, x], L[v, x] = saved[n, 4, x], saved[n, 5, x]
                for i in range(1 + 3 * bodies.framed[v]):
                    y[bodies.row[v] + i, x] = saved[n, i, x]
                for k in range(m):
                    P[v, x] += impulse[k] * G[k, n, x]
                    L[v, x] += impulse[k] * G[k, n, 3 + x]
            drift(v, dt, bodies, y, P, L, A, w)
        gap = _gaps(c, joints, y, gaps)
        if gap <= CLOSED or (gap < 1e-12 and gap > 0.5 * last):
            return iteration, 0.0
        last = gap
        _solve(m, S, gaps)
        for k in range(m):
            impulse[k] -= gaps[k] / dt
    return -1, last


@plain
def _earlier(k, j, when, queue):  # type: ignore[no-untyped-def]
    """Whether entry k of the queue comes before entry j: ties by the number of the element."""
    a, b = queue[k], queue[j]
    return when[a] < when[b] or (when[a] == when[b] and a < b)


@plain
def _sift(k, length, when, queue):  # type: ignore[no-untyped-def]
    """Let an entry of the heap sink to its place."""
    while True:
        child = 2 * k + 1
        if child >= length:
            return
        if child + 1 < length and _earlier(child + 1, child, when, queue):
            child += 1
        if not _earlier(child, k, when, queue):
            return
        queue[k], queue[child] = queue[child], queue[k]
        k = child


@plain
def _filled(counts, when, done, queue):  # type: ignore[no-untyped-def]
    """Queue all elements that kick within a round; how many."""
    length = 0
    for e in range(counts.shape[0]):
        if counts[e] > 1:
            queue[length], when[e], done[e] = e, 1.0 / counts[e], 1
            length += 1
    for k in range(length // 2 - 1, -1, -1):
        _sift(k, length, when, queue)
    return length


@plain
def _move(joined, now, h, clock, bodies, joints, y, P, L, room):  # type: ignore[no-untyped-def]
    """Bring a cluster to a time; iterations and gap."""
    A, w, G, S, gaps, impulse, saved = room
    first, stop = joints.vertex_start[joined], joints.vertex_start[joined + 1]
    dt = h * (now - clock[joints.vertices[first]])
    if dt == 0.0:
        return 0, 0.0
    for n in range(first, stop):
        clock[joints.vertices[n]] = now
    return drift_joined(joined, dt, bodies, joints, y, P, L, A, w, G, S, gaps, impulse, saved)


@plain
def _load(factor, dead, amplitudes, turning, bodies, y, P, L):  # type: ignore[no-untyped-def]
    """Kick by dead loads; `turning`: whether any acts on directors."""
    for channel in range(dead.shape[0]):
        f = factor * amplitudes[channel]
        for v in range(P.shape[0]):
            r = bodies.row[v]
            for x in range(3):
                P[v, x] += f * dead[channel, r, x]
            if bodies.framed[v] == 0 or not turning:
                continue
            for i in range(1, 4):
                for x in range(3):
                    j, k = (x + 1) % 3, (x + 2) % 3
                    moment = y[r + i, j] * dead[channel, r + i, k]
                    L[v, x] += f * (moment - y[r + i, k] * dead[channel, r + i, j])


@plain
def _changed(amplitudes, turn):  # type: ignore[no-untyped-def]
    """Whether the loads of a round are not those of the one before."""
    for channel in range(amplitudes.shape[1]):
        if amplitudes[turn, channel] != amplitudes[turn - 1, channel]:
            return True
    return False


@plain
def _potential(dead, amplitudes, y):  # type: ignore[no-untyped-def]
    """Dead loads times coordinates."""
    total = 0.0
    for channel in range(dead.shape[0]):
        each = 0.0
        for r in range(dead.shape[1]):
            for x in range(3):
                each += dead[channel, r, x] * y[r, x]
        total += amplitudes[channel] * each
    return total


@plain
def _largest(joints):  # type: ignore[no-untyped-def]
    """Rows and nodes of the largest clusters, at least one."""
    rows = vertices = 1
    for c in range(joints.row_start.shape[0] - 1):
        rows = max(rows, joints.row_start[c + 1] - joints.row_start[c])
        vertices = max(vertices, joints.vertex_start[c + 1] - joints.vertex_start[c])
    return rows, vertices


@jit
def march(bodies, joints, elements, y, P, L, KP, KL, dead, amplitudes, turning, h):  # type: ignore[no-untyped-def]
    """March as many rounds of size h as there are rows of amplitudes, in place.

    KP, KL (nv, 3): impulses of half a kick of all elements, at the start and on return at the end.
    """
    nv, ne, nn = P.shape[0], elements.counts.shape[0], elements.vertices.shape[1]
    D, F, T = np.empty((8, 3)), np.empty((nn, 4, 3)), np.empty(12)
    rows, vertices = _largest(joints)
    A, w, cluster_of = np.empty((3, 3)), np.empty(6), joints.cluster_of
    G, S = np.empty((rows, vertices, 6)), np.empty((rows, rows))
    room = A, w, G, S, np.empty(rows), np.empty(rows), np.empty((vertices, 6, 3))
    clock, when = np.empty(nv), np.empty(ne)
    queue, done = np.empty(ne, dtype=np.int64), np.empty(ne, dtype=np.int64)
    evaluations, most, done_work = 0, 0, 0.0
    for turn in range(amplitudes.shape[0]):
        for v in range(nv):
            clock[v] = 0.0
            for x in range(3):
                P[v, x] += KP[v, x]
                L[v, x] += KL[v, x]
        _load(0.5 * h, dead, amplitudes[turn], turning, bodies, y, P, L)
        if turn == 0 or _changed(amplitudes, turn):
            done_work -= _potential(dead, amplitudes[turn], y)
        length = _filled(elements.counts, when, done, queue)
        while length > 0:
            e = queue[0]
            now = when[e]
            for a in range(nn):
                v = elements.vertices[e, a]
                if cluster_of[v] < 0:
                    drift(v, h * (now - clock[v]), bodies, y, P, L, A, w)
                    clock[v] = now
                    continue
                found, gap = _move(cluster_of[v], now, h, clock, bodies, joints, y, P, L, room)
                if found < 0:
                    return evaluations, done_work, most, gap
                most = max(most, found)
            kick(e, h / elements.counts[e], elements, bodies.row, y, P, L, D, T, F)
            evaluations += 1
            done[e] += 1
            if done[e] < elements.counts[e]:
                when[e] = done[e] / elements.counts[e]
            else:
                length -= 1
                queue[0] = queue[length]
            _sift(0, length, when, queue)
        for v in range(nv):
            for x in range(3):
                KP[v, x], KL[v, x] = 0.0, 0.0
            if cluster_of[v] < 0:
                drift(v, h * (1.0 - clock[v]), bodies, y, P, L, A, w)
                continue
            found, gap = _move(cluster_of[v], 1.0, h, clock, bodies, joints, y, P, L, room)
            if found < 0:
                return evaluations, done_work, most, gap
            most = max(most, found)
        for e in range(ne):
            kick(e, 0.5 * h / elements.counts[e], elements, bodies.row, y, KP, KL, D, T, F)
        evaluations += ne
        for v in range(nv):
            for x in range(3):
                P[v, x] += KP[v, x]
                L[v, x] += KL[v, x]
        _load(0.5 * h, dead, amplitudes[turn], turning, bodies, y, P, L)
        if turn + 1 == amplitudes.shape[0] or _changed(amplitudes, turn + 1):
            done_work += _potential(dead, amplitudes[turn], y)
    return evaluations, done_work, most, 0.0
