"""The compiled loop over the rounds of an explicit step, with its priority queue."""

from __future__ import annotations

import numpy as np

from ..jit import jit
from .parts import drift, drift_joined, kick, plain

__all__ = ["march"]


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
def _move(v, now, h, clock, bodies, joints, y, P, L, work):  # type: ignore[no-untyped-def]
    """Bring node v, with all that joints connect to it, to a time; iterations and gap."""
    A, w, G, S, gaps, impulse, saved = work
    dt = h * (now - clock[v])
    if dt == 0.0:
        return 0, 0.0
    c = joints.cluster_of[v]
    if c < 0:
        drift(v, dt, bodies, y, P, L, A, w)
        clock[v] = now
        return 0, 0.0
    found = drift_joined(c, dt, bodies, joints, y, P, L, A, w, G, S, gaps, impulse, saved)
    for n in range(joints.vertex_start[c], joints.vertex_start[c + 1]):
        clock[joints.vertices[n]] = now
    return found


@plain
def _load(factor, dead, amplitudes, bodies, y, P, L):  # type: ignore[no-untyped-def]
    """Kick by dead loads."""
    for channel in range(dead.shape[0]):
        f = factor * amplitudes[channel]
        for v in range(P.shape[0]):
            r = bodies.row[v]
            for x in range(3):
                P[v, x] += f * dead[channel, r, x]
            if bodies.framed[v] == 0:
                continue
            for i in range(1, 4):
                for x in range(3):
                    j, k = (x + 1) % 3, (x + 2) % 3
                    moment = y[r + i, j] * dead[channel, r + i, k]
                    L[v, x] += f * (moment - y[r + i, k] * dead[channel, r + i, j])


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


@jit
def march(bodies, joints, elements, y, P, L, KP, KL, dead, amplitudes, h):  # type: ignore[no-untyped-def]
    """March as many rounds of size h as there are rows of amplitudes, in place.

    KP, KL (nv, 3): impulses of half a kick of all elements, at the start and on return at the end.
    """
    nv, ne, nn = P.shape[0], elements.counts.shape[0], elements.vertices.shape[1]
    rows = vertices = 1
    for c in range(joints.row_start.shape[0] - 1):
        rows = max(rows, joints.row_start[c + 1] - joints.row_start[c])
        vertices = max(vertices, joints.vertex_start[c + 1] - joints.vertex_start[c])
    D, F, T = np.empty((8, 3)), np.empty((nn, 4, 3)), np.empty(12)
    work = (
        np.empty((3, 3)),
        np.empty(6),
        np.empty((rows, vertices, 6)),
        np.empty((rows, rows)),
        np.empty(rows),
        np.empty(rows),
        np.empty((vertices, 6, 3)),
    )
    clock, when = np.empty(nv), np.empty(ne)
    queue, done = np.empty(ne, dtype=np.int64), np.empty(ne, dtype=np.int64)
    evaluations, most, done_work = 0, 0, 0.0
    for turn in range(amplitudes.shape[0]):
        for v in range(nv):
            clock[v] = 0.0
            for x in range(3):
                P[v, x] += KP[v, x]
                L[v, x] += KL[v, x]
        _load(0.5 * h, dead, amplitudes[turn], bodies, y, P, L)
        done_work -= _potential(dead, amplitudes[turn], y)
        length = 0
        for e in range(ne):
            if elements.counts[e] > 1:
                queue[length], when[e], done[e] = e, 1.0 / elements.counts[e], 1
                length += 1
        for k in range(length // 2 - 1, -1, -1):
            _sift(k, length, when, queue)
        while length > 0:
            e = queue[0]
            now = when[e]
            for a in range(nn):
                v = elements.vertices[e, a]
                found, gap = _move(v, now, h, clock, bodies, joints, y, P, L, work)
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
            found, gap = _move(v, 1.0, h, clock, bodies, joints, y, P, L, work)
            if found < 0:
                return evaluations, done_work, most, gap
            most = max(most, found)
            for x in range(3):
                KP[v, x], KL[v, x] = 0.0, 0.0
        for e in range(ne):
            kick(e, 0.5 * h / elements.counts[e], elements, bodies.row, y, KP, KL, D, T, F)
        evaluations += ne
        for v in range(nv):
            for x in range(3):
                P[v, x] += KP[v, x]
                L[v, x] += KL[v, x]
        _load(0.5 * h, dead, amplitudes[turn], bodies, y, P, L)
        done_work += _potential(dead, amplitudes[turn], y)
    return evaluations, done_work, most, 0.0
