"""Products of many vectors, eight at once: what is read is used several times, and the compiler fills its lanes."""

from fitting_core.fit.compiled.jit import helper


@helper
def product(a, b, count, zero):
    """a . b over the first `count` numbers; `zero` is 0 in their type."""
    total = zero
    for k in range(count):
        total += a[k] * b[k]
    return total


@helper
def _eight(a0, a1, a2, a3, b0, b1, count, zero):
    """Four vectors times two."""
    p0 = p1 = p2 = p3 = q0 = q1 = q2 = q3 = zero
    for k in range(count):
        x, y, w0, w1, w2, w3 = b0[k], b1[k], a0[k], a1[k], a2[k], a3[k]
        p0 += w0 * x
        p1 += w1 * x
        p2 += w2 * x
        p3 += w3 * x
        q0 += w0 * y
        q1 += w1 * y
        q2 += w2 * y
        q3 += w3 * y
    return p0, p1, p2, p3, q0, q1, q2, q3


@helper
def products(a, rows, b, columns, count, zero, out):
    """out[j, i] = a[i] . b[j] for the first rows of both, over their first `count` numbers."""
    for i in range(0, rows - rows % 4, 4):
        _four_rows(a, i, b, columns, count, zero, out)
    for i in range(rows - rows % 4, rows):
        for j in range(columns):
            out[j, i] = product(a[i], b[j], count, zero)


@helper
def half_products(a, rows, b, count, out):
    """The same for as many rows of both, where j <= i."""
    for i in range(0, rows - rows % 4, 4):
        _four_rows(a, i, b, i + 4, count, 0.0, out)
    for i in range(rows - rows % 4, rows):
        for j in range(i + 1):
            out[j, i] = product(a[i], b[j], count, 0.0)


@helper
def _four_rows(a, i, b, columns, count, zero, out):
    even = columns - columns % 2
    a0, a1, a2, a3 = a[i], a[i + 1], a[i + 2], a[i + 3]
    for j in range(0, even, 2):
        found = _eight(a0, a1, a2, a3, b[j], b[j + 1], count, zero)
        one, other = out[j], out[j + 1]
        one[i], one[i + 1], one[i + 2], one[i + 3] = found[0], found[1], found[2], found[3]
        other[i], other[i + 1], other[i + 2], other[i + 3] = found[4], found[5], found[6], found[7]
    for j in range(even, columns):
        found = _eight(a0, a1, a2, a3, b[j], b[j], count, zero)
        one = out[j]
        one[i], one[i + 1], one[i + 2], one[i + 3] = found[0], found[1], found[2], found[3]
