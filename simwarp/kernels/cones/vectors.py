"""Operations on the rows of an array of vectors."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func_native("""
    const size_t pitch = vectors.strides[0] / sizeof(float);
    const float* __restrict__ a = vectors.data + source * pitch;
    float* __restrict__ b = vectors.data + target * pitch;
#pragma clang loop vectorize_width(4) interleave_count(1)
    for (int i = 0; i < n; ++i) b[i] = a[i];
""")
def copy(n: int, vectors: wp.array2d[float], source: int, target: int):
    """vectors[target] <- vectors[source]."""
    ...


@wp.func_native("""
#pragma clang fp reassociate(on)
    const float* __restrict__ x = (const float*)((const char*)a.data + (size_t)i * a.strides[0]);
    const float* __restrict__ y = (const float*)((const char*)vectors.data + (size_t)source * vectors.strides[0]);
    float total = 0.0f;
#pragma clang loop vectorize_width(4) interleave_count(2)
    for (int k = 0; k < n; ++k) total += x[k] * y[k];
    return total;
""")
def dot_row_vector(n: int, a: wp.array2d[float], i: int, vectors: wp.array2d[float], source: int) -> float:
    """Row i of a times vectors[source]."""
    ...
