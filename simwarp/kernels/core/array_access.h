// Elements of arrays as the step's kernels of a CPU reach them; included before a kernel's own text.
//
// Warp counts a negative index from the end of an array, and multiplies every index by a stride that it reads from
// memory: nine instructions, one after the other, before an element is loaded. Tables of models are chains of such
// loads. Here an index is at least zero, and the innermost axis is contiguous (core/cpu_flags.py): one or three.
//
// With CHECK_INDICES a negative index stops the process.

#pragma once
#define WP_NO_CRT
#define WP_TILE_BLOCK_DIM 1
#include "builtin.h"

namespace wp {

#ifdef CHECK_INDICES
inline int checked_index(int i)
{
    if (i < 0)
        __builtin_trap();
    return i;
}
#else
inline int checked_index(int i) { return i; }
#endif

template <typename T> inline T* row_of(const array_t<T>& a, size_t bytes) { return (T*)((char*)a.data + bytes); }

template <typename T> inline T* address(const array_t<T>& a, int i) { return a.data + checked_index(i); }

template <typename T> inline T* address(const array_t<T>& a, int i, int j)
{
    return row_of(a, checked_index(i) * (size_t)a.strides[0]) + checked_index(j);
}

template <typename T> inline T* address(const array_t<T>& a, int i, int j, int k)
{
    return row_of(a, checked_index(i) * (size_t)a.strides[0] + checked_index(j) * (size_t)a.strides[1])
        + checked_index(k);
}

template <typename T> inline void array_store(const array_t<T>& a, int i, T value) { *address(a, i) = value; }

template <typename T> inline void array_store(const array_t<T>& a, int i, int j, T value)
{
    *address(a, i, j) = value;
}

template <typename T> inline void array_store(const array_t<T>& a, int i, int j, int k, T value)
{
    *address(a, i, j, k) = value;
}

}  // namespace wp
