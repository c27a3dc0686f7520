/* Memory of the emulated device: blocks, which of its bytes may be accessed, and who touched a word in a launch. */
#define _GNU_SOURCE
#define EMU_RUNTIME
#include "device_threads.h"
#include <fcntl.h>
#include <setjmp.h>
#include <stdio.h>
#include <sys/mman.h>
#include <unistd.h>

#define PAGE 4096ull
#define GAP 256ull /* between blocks: an index that runs over an end meets no other block */
#define PRIVATE (MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE)

uint8_t *emu_shadow;
static int arena_file;
static uint64_t arena_size;

/* Returns 0, or the number of the step that failed. */
int emu_open(uint64_t size) {
    arena_size = size;
    arena_file = memfd_create("emulated_cuda", 0);
    if (arena_file < 0 || ftruncate(arena_file, (off_t)size)) return 1;
    int flags = MAP_SHARED | MAP_FIXED_NOREPLACE | MAP_NORESERVE;
    void *alias = (void *)(EMU_BASE + EMU_DELTA);
    if (mmap(alias, size, PROT_READ | PROT_WRITE, flags, arena_file, 0) != alias) return 2;
    if (mmap((void *)EMU_BASE, size, PROT_NONE, flags, arena_file, 0) != (void *)EMU_BASE) return 3;
    emu_shadow = mmap(0, size >> 3, PROT_READ | PROT_WRITE, PRIVATE, -1, 0);
    return emu_shadow == MAP_FAILED ? 4 : 0;
}
/* Whether the host may access the device's memory. */
int emu_open_to_host(int on) { return mprotect((void *)EMU_BASE, arena_size, on ? PROT_READ | PROT_WRITE : PROT_NONE); }

/* Blocks. An address is never given twice, so that freed memory stays out of bounds. */
typedef struct { uint64_t size, stream; } Block; /* by address / 256 */
static Block *blocks;
static uint64_t top = EMU_BASE + 65536, used, high, count;
static Block *block_at(uint64_t a) { return blocks + ((a - EMU_BASE) >> 8); }

static void mark(uint64_t a, uint64_t n, int valid) {
    uint8_t *s = emu_shadow + ((a - EMU_BASE) >> 3);
    memset(s, valid ? 8 : 0, n >> 3);
    if (n & 7) s[n >> 3] = valid ? n & 7 : 0;
}
/* A block filled with ones, which are NaN; 0 where the arena is full. `stream` is that of stream-ordered memory. */
uint64_t emu_alloc(uint64_t size, uint64_t stream) {
    if (!blocks) blocks = mmap(0, (arena_size >> 8) * sizeof(Block), PROT_READ | PROT_WRITE, PRIVATE, -1, 0);
    if (!size) size = 1;
    uint64_t a = __atomic_fetch_add(&top, (size + GAP + 255) & ~255ull, __ATOMIC_SEQ_CST);
    if (a + size > EMU_BASE + arena_size) return 0;
    memset((void *)(a + EMU_DELTA), 0xff, size);
    mark(a, size, 1);
    *block_at(a) = (Block){size, stream};
    uint64_t now = __atomic_add_fetch(&used, size, __ATOMIC_SEQ_CST);
    if (now > high) high = now;
    ++count;
    return a;
}
uint64_t emu_size(uint64_t a) { return blocks && EMU_IS_DEVICE(a) && !(a & 255) ? block_at(a)->size : 0; }
uint64_t emu_stream(uint64_t a) { return emu_size(a) ? block_at(a)->stream : 0; }
void emu_release(uint64_t a) {
    uint64_t n = emu_size(a);
    if (!n) return;
    block_at(a)->size = 0;
    mark(a, n, 0);
    uint64_t first = (a + PAGE - 1) & ~(PAGE - 1), last = (a + n) & ~(PAGE - 1);
    if (last > first)
        fallocate(arena_file, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, (off_t)(first - EMU_BASE), (off_t)(last - first));
    __atomic_fetch_sub(&used, n, __ATOMIC_SEQ_CST);
}
/* Whether all of a range lies in one block. */
int emu_in_block(uint64_t a, uint64_t n) {
    if (!EMU_IS_DEVICE(a)) return 0;
    if (!n) return 1;
    uint8_t *s = emu_shadow;
    uint64_t b = a - EMU_BASE, e = b + n - 1;
    if (s[b >> 3] <= (b & 7) || s[e >> 3] <= (e & 7)) return 0;
    for (uint64_t k = (b >> 3) + 1; k < e >> 3; ++k)
        if (s[k] != 8) return 0;
    return 1;
}
uint64_t emu_used(void) { return used; }
uint64_t emu_high(void) { return high; }
uint64_t emu_count(void) { return count; }

/* Blocks that the host gave up and that a stream has yet to release. */
typedef struct Given { uint64_t address; struct Given *next; } Given;
static Given *given;
void emu_give_up(uint64_t host_address) {
    Given *one = malloc(sizeof *one);
    one->address = host_address - EMU_DELTA;
    one->next = __atomic_load_n(&given, __ATOMIC_RELAXED);
    while (!__atomic_compare_exchange_n(&given, &one->next, one, 1, __ATOMIC_SEQ_CST, __ATOMIC_RELAXED)) {}
}
uint64_t emu_next_given_up(void) { /* 0: none is left */
    Given *one = __atomic_load_n(&given, __ATOMIC_RELAXED);
    if (!one) return 0;
    while (!__atomic_compare_exchange_n(&given, &one, one->next, 1, __ATOMIC_SEQ_CST, __ATOMIC_RELAXED)) {}
    uint64_t address = one->address;
    free(one);
    return address;
}

/* Ranges of host memory that device code may access: variables of modules, trees that were built on the host. */
#define RANGES 65536
static struct { uint64_t low, high; } ranges[RANGES];
static int range_count;
void emu_allow(const void *p, uint64_t n) {
    int k = 0;
    while (k < range_count && ranges[k].low != ranges[k].high) ++k;
    if (k == RANGES) return;
    range_count += k == range_count;
    ranges[k].low = (uint64_t)p;
    ranges[k].high = (uint64_t)p + n;
}
void emu_disallow(const void *p) {
    for (int k = 0; k < range_count; ++k)
        if (ranges[k].low == (uint64_t)p) ranges[k].low = ranges[k].high = 0;
}

static __attribute__((noreturn)) void fail(C *c, int line, const char *what, uint64_t a, uint32_t n, int access) {
    const char *kind = access == 2 ? "atomic" : access ? "write" : "read";
    char text[512];
    snprintf(text, sizeof text, "%s: %s of %u bytes at 0x%llx", what, kind, n, (unsigned long long)a);
    emu_stop(c, line, text, a & (n - 1) ? 716 : 700);
}
void *emu_slow(C *c, uint64_t a, uint32_t n, int line, int access) {
    if (a & (n - 1)) fail(c, line, "misaligned address", a, n, access);
    if (EMU_IS_DEVICE(a)) fail(c, line, "out of bounds or freed", a, n, access);
    for (int k = 0; k < range_count; ++k)
        if (a >= ranges[k].low && a + n <= ranges[k].high) return (void *)a;
    fail(c, line, a < 65536 ? "null pointer" : "host memory", a, n, access);
}
void *emu_generic(C *c, uint64_t a, uint32_t n, int line, int access) {
    uint64_t here = (uint64_t)__builtin_frame_address(0), shared = (uint64_t)c->smem;
    if ((a >= here && a < c->stack_top) || (a >= shared && a < shared + SHARED_BYTES)) return (void *)a;
    return emu_slow(c, a, n, line, access);
}

static int checks; /* 1: memory, 2: races too */
void emu_checks(int level) { checks = level; }
void *emu_global_pointer(C *c, uint64_t a, uint32_t n, int line, int access) {
    if (!LIKELY(EMU_IS_DEVICE(a) && !(a & (n - 1)))) return emu_slow(c, a, n, line, access);
    if (checks && !emu_is_valid(a, n)) return emu_slow(c, a, n, line, access);
    if (checks > 1) emu_race(c, a, n, line, access);
    if (emu_counting) emu_access(c, line, access, n, a);
    return (void *)(a + EMU_DELTA);
}
void *emu_generic_pointer(C *c, uint64_t a, uint32_t n, int line, int access) {
    return EMU_IS_DEVICE(a) ? emu_global_pointer(c, a, n, line, access) : emu_generic(c, a, n, line, access);
}

/* Races: the last writer and the last readers of each word in a launch. Threads are numbers of the grid, from 1;
 * accesses of two threads of a block are in order if a barrier lies between them, of two lanes that wait for each other
 * if that has happened in between. */
typedef struct { uint32_t block, warp; } Epoch;
typedef struct {
    uint32_t launch, writer, reader, earlier; /* the last reader, and the last before it that was another */
    Epoch write_epoch, read_epoch, earlier_epoch;
    uint8_t apart; /* readers are of several blocks */
    uint8_t atomic;
} Word;
static Word *words;
static uint64_t race_count;
static char first_race[1024];
int emu_open_races(void) {
    words = mmap(0, (arena_size >> 2) * sizeof(Word), PROT_READ | PROT_WRITE, PRIVATE, -1, 0);
    if (words == MAP_FAILED) words = 0;
    return !words;
}
uint64_t emu_races(char *out, uint64_t n) { snprintf(out, n, "%s", first_race); return race_count; }
void emu_clear_races(void) { race_count = 0; first_race[0] = 0; }

static uint32_t block_of(const C *c, uint32_t thread) { return (thread - 1) / (c->ntid[0] * c->ntid[1] * c->ntid[2]); }
static Epoch epoch_of(const C *c) { return (Epoch){c->epoch, c->warp_epoch}; }
/* Whether another thread of the block has waited with this one since. */
static int has_waited(const C *c, uint32_t other, Epoch epoch) {
    if (epoch.block != c->epoch) return 1;
    uint32_t first = block_of(c, c->thread) * (c->ntid[0] * c->ntid[1] * c->ntid[2]) + 1;
    uint32_t lane = other - first, mine = c->thread - first;
    return lane / 32 == mine / 32 && (c->members >> lane % 32 & 1) && epoch.warp != c->warp_epoch;
}
static int in_order(const C *c, uint32_t other, Epoch epoch) {
    return other == c->thread || (block_of(c, other) == block_of(c, c->thread) && has_waited(c, other, epoch));
}
static void note_race(C *c, uint64_t a, int line, const char *what, uint32_t other) {
    if (race_count++) return;
    snprintf(first_race, sizeof first_race, "%s of thread %u at 0x%llx by thread %u in %s, PTX line %d", what, other - 1,
             (unsigned long long)a, c->thread - 1, emu_kernel_name, line);
}
static void race_of_word(C *c, Word *x, uint64_t a, uint32_t n, int line, int access) {
    /* Threads may store bytes of one word: only whole words count. */
    int whole = n >= 4;
    if (access == 0) {
        if (x->writer && whole && !in_order(c, x->writer, x->write_epoch)) note_race(c, a, line, "read after the write", x->writer);
        if (x->reader && x->reader != c->thread) {
            x->apart |= block_of(c, x->reader) != block_of(c, c->thread);
            x->earlier = x->reader;
            x->earlier_epoch = x->read_epoch;
        }
        x->reader = c->thread;
        x->read_epoch = epoch_of(c);
        return;
    }
    int atomics = access == 2 && x->atomic;
    if (x->writer && whole && !atomics && !in_order(c, x->writer, x->write_epoch))
        note_race(c, a, line, access == 2 ? "atomic after the write" : "write after the write", x->writer);
    else if (x->reader && whole && access == 1) {
        if (x->apart || !in_order(c, x->reader, x->read_epoch)) note_race(c, a, line, "write after the read", x->reader);
        else if (x->earlier && !in_order(c, x->earlier, x->earlier_epoch))
            note_race(c, a, line, "write after the read", x->earlier);
    }
    x->writer = c->thread;
    x->write_epoch = epoch_of(c);
    x->atomic = access == 2;
}
void emu_race(C *c, uint64_t a, uint32_t n, int line, int access) {
    if (!words) return;
    for (uint64_t w = (a - EMU_BASE) >> 2; w <= (a + n - 1 - EMU_BASE) >> 2; ++w) {
        Word *x = words + w;
        if (x->launch != emu_launch_number) *x = (Word){.launch = emu_launch_number};
        race_of_word(c, x, EMU_BASE + (w << 2), n, line, access);
    }
}
