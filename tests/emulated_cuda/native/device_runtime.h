#pragma once
/* What translated PTX needs: the context of a thread, checked pointers, and PTX's arithmetic where C's differs.
 *
 * The device's memory is mapped twice: at EMU_BASE without any right, so that the host's accesses are faults, and
 * EMU_DELTA higher for device code.
 */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define EMU_DEVICE_SHIFT 36
#define EMU_DEVICE_TAG 0x200ull
#define EMU_DELTA 0x080000000000ull
#define EMU_BASE (EMU_DEVICE_TAG << EMU_DEVICE_SHIFT)
#define EMU_IS_DEVICE(a) ((a) >> EMU_DEVICE_SHIFT == EMU_DEVICE_TAG)

typedef struct C {
    uint32_t tid[3], ntid[3], ctaid[3], nctaid[3];
    char *smem; /* shared memory of the block */
    uint32_t smem_static, smem_dynamic;
    uint64_t stack_top; /* of this thread's C stack */
    uint32_t thread; /* number in the grid, from 1 */
    uint32_t epoch; /* barriers of the block that this thread has passed */
    uint32_t warp_epoch, members; /* the same of its warp, and the lanes that passed the last with it */
    void *fiber;
} C;

/* Accesses: 0 reads, 1 writes, 2 is atomic. */
extern void *emu_slow(C *c, uint64_t a, uint32_t n, int line, int access);
extern void *emu_generic(C *c, uint64_t a, uint32_t n, int line, int access);
extern void emu_race(C *c, uint64_t a, uint32_t n, int line, int access);
extern uint8_t *emu_shadow;
extern void emu_allow(const void *p, uint64_t n);
extern void emu_barrier(C *c, uint32_t number, int line);
extern uint64_t emu_shuffle(C *c, int mode, uint32_t v, uint32_t b, uint32_t limits, uint32_t mask, int line, uint8_t *p);
extern uint32_t emu_vote(C *c, int mode, int p, uint32_t mask, int line);
extern void emu_trap(C *c, int line, const char *why);
extern uint32_t emu_vprintf(C *c, uint64_t format, uint64_t arguments);

/* Counting of warps (warp_counts.c): a thread notes the blocks that it enters and what it accesses. */
extern int emu_counting;
extern void emu_block(C *c, uint32_t block);
extern void emu_access(C *c, int line, int access, uint32_t size, uint64_t address);
#ifdef EMU_COUNT
#define B(c, block) emu_block(c, block)
#else
#define B(c, block)
#endif

#define LIKELY(x) __builtin_expect(!!(x), 1)

/* Each byte of the shadow stands for eight bytes of memory: how many of them may be accessed. */
static inline __attribute__((always_inline)) int emu_is_valid(uint64_t a, uint32_t n) {
    const uint8_t *s = emu_shadow + ((a - EMU_BASE) >> 3);
    if (n <= 8) return s[0] >= (a & 7) + n;
    for (uint32_t k = 0; k < n >> 3; ++k)
        if (s[k] != 8) return 0;
    return 1;
}

#if !defined(__OPTIMIZE__) && !defined(EMU_RUNTIME)
/* Without optimisation a call compiles faster than what it does. */
extern void *emu_global_pointer(C *c, uint64_t a, uint32_t n, int line, int access);
extern void *emu_generic_pointer(C *c, uint64_t a, uint32_t n, int line, int access);
#define GP emu_global_pointer
#define GN emu_generic_pointer
#else
static inline __attribute__((always_inline)) void *GP(C *c, uint64_t a, uint32_t n, int line, int access) {
    if (LIKELY(EMU_IS_DEVICE(a) && !(a & (n - 1)))) {
#ifdef EMU_CHECK
        if (!LIKELY(emu_is_valid(a, n))) return emu_slow(c, a, n, line, access);
#endif
#ifdef EMU_RACE
        emu_race(c, a, n, line, access);
#endif
#ifdef EMU_COUNT
        if (emu_counting) emu_access(c, line, access, n, a);
#endif
        return (void *)(a + EMU_DELTA);
    }
    return emu_slow(c, a, n, line, access);
}
static inline __attribute__((always_inline)) void *GN(C *c, uint64_t a, uint32_t n, int line, int access) {
    return EMU_IS_DEVICE(a) ? GP(c, a, n, line, access) : emu_generic(c, a, n, line, access);
}
#endif

static inline float BF(uint32_t u) { float f; memcpy(&f, &u, 4); return f; }
static inline double BD(uint64_t u) { double f; memcpy(&f, &u, 8); return f; }
static inline uint32_t FB(float f) { uint32_t u; memcpy(&u, &f, 4); return u; }
static inline uint64_t DB(double f) { uint64_t u; memcpy(&u, &f, 8); return u; }

#define ACCESS(T) \
    static inline T ld_##T(const void *p) { T v; memcpy(&v, p, sizeof v); return v; } \
    static inline void st_##T(void *p, T v) { memcpy(p, &v, sizeof v); }
ACCESS(uint8_t) ACCESS(int8_t) ACCESS(uint16_t) ACCESS(int16_t) ACCESS(uint32_t) ACCESS(int32_t)
ACCESS(uint64_t) ACCESS(int64_t) ACCESS(float) ACCESS(double)

/* NaN loses against a number; -0 is less than +0. */
#define EXTREMUM(NAME, T, BITS, VALUE, SIGN, ZEROS) \
    static inline T NAME(T a, T b) { \
        if (a != a) return b; \
        if (b != b) return a; \
        if (a == b) return VALUE(BITS(a) ZEROS BITS(b)); \
        return a SIGN b ? a : b; \
    }
EXTREMUM(minF, float, FB, BF, <, |) EXTREMUM(maxF, float, FB, BF, >, &)
EXTREMUM(minD, double, DB, BD, <, |) EXTREMUM(maxD, double, DB, BD, >, &)
static inline float ftz(float a) { return fabsf(a) < 1.17549435e-38f ? copysignf(0.0f, a) : a; }
static inline float satF(float a) { return a != a || a < 0.0f ? 0.0f : a > 1.0f ? 1.0f : a; }
static inline double satD(double a) { return a != a || a < 0.0 ? 0.0 : a > 1.0 ? 1.0 : a; }

#define TO_INTEGER(NAME, T, LOW, HIGH, MIN, MAX) \
    static inline T NAME(double x, T nan) { return x != x ? nan : x <= LOW ? MIN : x >= HIGH ? MAX : (T)x; }
TO_INTEGER(f_s32, int32_t, -2147483648.0, 2147483647.0, INT32_MIN, INT32_MAX)
TO_INTEGER(f_u32, uint32_t, 0.0, 4294967295.0, 0, UINT32_MAX)
TO_INTEGER(f_s64, int64_t, -9223372036854775808.0, 9223372036854775807.0, INT64_MIN, INT64_MAX)
TO_INTEGER(f_u64, uint64_t, 0.0, 18446744073709551615.0, 0, UINT64_MAX)
TO_INTEGER(f_s16, int16_t, -32768.0, 32767.0, INT16_MIN, INT16_MAX)
TO_INTEGER(f_u16, uint16_t, 0.0, 65535.0, 0, UINT16_MAX)
TO_INTEGER(f_s8, int8_t, -128.0, 127.0, INT8_MIN, INT8_MAX)
TO_INTEGER(f_u8, uint8_t, 0.0, 255.0, 0, UINT8_MAX)

static inline uint32_t bfind32(uint32_t x, int as_shift) {
    if (!x) return 0xffffffffu;
    int k = 31 - __builtin_clz(x);
    return as_shift ? 31 - k : k;
}
static inline uint32_t bfind64(uint64_t x, int as_shift) {
    if (!x) return 0xffffffffu;
    int k = 63 - __builtin_clzll(x);
    return as_shift ? 63 - k : k;
}
static inline uint32_t brev32(uint32_t x) {
    x = (x >> 1 & 0x55555555u) | (x & 0x55555555u) << 1;
    x = (x >> 2 & 0x33333333u) | (x & 0x33333333u) << 2;
    x = (x >> 4 & 0x0f0f0f0fu) | (x & 0x0f0f0f0fu) << 4;
    return __builtin_bswap32(x);
}
static inline uint64_t brev64(uint64_t x) { return (uint64_t)brev32((uint32_t)x) << 32 | brev32((uint32_t)(x >> 32)); }
static inline uint64_t bfi(uint64_t a, uint64_t b, uint32_t pos, uint32_t len, uint32_t bits) {
    pos &= 255; len &= 255;
    if (pos >= bits || !len) return b;
    if (len > bits - pos) len = bits - pos;
    uint64_t m = (len >= 64 ? ~0ull : (1ull << len) - 1) << pos;
    return (b & ~m) | ((a << pos) & m);
}
static inline uint64_t bfe_u(uint64_t a, uint32_t pos, uint32_t len, uint32_t bits) {
    pos &= 255; len &= 255;
    if (!len || pos >= bits) return 0;
    a >>= pos;
    if (len > bits - pos) len = bits - pos;
    return len >= 64 ? a : a & ((1ull << len) - 1);
}
static inline int64_t bfe_s(int64_t a, uint32_t pos, uint32_t len, uint32_t bits) {
    pos &= 255; len &= 255;
    if (!len) return 0;
    if (pos >= bits) return a < 0 ? -1 : 0;
    a >>= pos;
    return len >= bits - pos ? a : (int64_t)((uint64_t)a << (64 - len)) >> (64 - len);
}
static inline uint32_t prmt(uint32_t a, uint32_t b, uint32_t s) {
    uint64_t v = (uint64_t)b << 32 | a;
    uint32_t r = 0;
    for (int i = 0; i < 4; ++i) {
        uint32_t k = s >> (4 * i) & 15, byte = v >> (8 * (k & 7)) & 255;
        if (k & 8) byte = byte & 128 ? 255 : 0;
        r |= byte << (8 * i);
    }
    return r;
}
static inline uint32_t lop3(uint32_t a, uint32_t b, uint32_t c, int table) {
    uint32_t r = 0;
    for (int k = 0; k < 8; ++k)
        if (table >> k & 1) r |= (k & 4 ? a : ~a) & (k & 2 ? b : ~b) & (k & 1 ? c : ~c);
    return r;
}
static inline uint32_t shf_l(uint32_t a, uint32_t b, uint32_t n, int clamp) {
    n = clamp ? (n > 32 ? 32 : n) : n & 31;
    return n >= 32 ? a : (uint32_t)((((uint64_t)b << 32 | a) << n) >> 32);
}
static inline uint32_t shf_r(uint32_t a, uint32_t b, uint32_t n, int clamp) {
    n = clamp ? (n > 32 ? 32 : n) : n & 31;
    return (uint32_t)(((uint64_t)b << 32 | a) >> n);
}
#define SHL(T, a, n, bits) ((n) >= bits ? (T)0 : (T)((T)(a) << (n)))
#define SHRU(T, a, n, bits) ((n) >= bits ? (T)0 : (T)((T)(a) >> (n)))
#define SHRS(T, a, n, bits) ((T)(a) >> ((n) >= bits ? bits - 1 : (n)))
/* The result of a division by zero is not specified; all ones are what cards give. */
#define DIVU(a, b) ((b) == 0 ? ~((a) * 0) : (a) / (b))
#define DIVS(a, b) ((b) == 0 ? -1 : (b) == -1 ? -(a) : (a) / (b))
#define REMU(a, b) ((b) == 0 ? (a) : (a) % (b))
#define REMS(a, b) ((b) == 0 ? (a) : (b) == -1 ? 0 : (a) % (b))
