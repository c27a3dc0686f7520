/* Launches: threads one after the other; threads of a block that wait for each other are fibers. */
#define _GNU_SOURCE
#define EMU_RUNTIME
#include "device_threads.h"
#include "warp_counts.h"
#include <setjmp.h>
#include <stdio.h>
#include <sys/mman.h>
#include <ucontext.h>

#define STACK 262144
#define WARP 32
#define VOTE_ALL 0
#define VOTE_ANY 1
#define VOTE_BALLOT 2
#define VOTE_UNIFORM 4
#define VOTE_NONE 3 /* waits for the other lanes, no more */
#define SHUFFLE 10

const char *emu_kernel_name = "?";
uint32_t emu_launch_number;
static jmp_buf escape;
static char message[1024];
const char *emu_message(void) { return message; }

void emu_stop(C *c, int line, const char *why, int code) {
    snprintf(message, sizeof message, "%s by thread (%u,%u,%u) of block (%u,%u,%u) in %s, PTX line %d", why, c->tid[0],
             c->tid[1], c->tid[2], c->ctaid[0], c->ctaid[1], c->ctaid[2], emu_kernel_name, line);
    longjmp(escape, code);
}
void emu_trap(C *c, int line, const char *why) { emu_stop(c, line, why, 719); }

enum State { READY, AT_BARRIER, IN_WARP, DONE };
typedef struct Fiber {
    ucontext_t context;
    C c;
    char *stack;
    enum State state;
    int mode, vote, line; /* what it waits for */
    uint32_t barrier, value, lane, limits, mask;
    uint32_t result; /* what it gets */
    uint8_t in_range;
} Fiber;
static Fiber *fibers;
static int fiber_room;
static ucontext_t scheduler;
static Fiber *running;
static void (*fiber_kernel)(C *, void **);
static void **fiber_params;

static void fiber_main(void) {
    fiber_kernel(&running->c, fiber_params);
    running->state = DONE;
    swapcontext(&running->context, &scheduler);
}
static void pause_in(enum State state) {
    Fiber *f = running;
    f->state = state;
    swapcontext(&f->context, &scheduler);
}
void emu_barrier(C *c, uint32_t number, int line) {
    if (!c->fiber) {
        if (c->ntid[0] * c->ntid[1] * c->ntid[2] > 1) emu_trap(c, line, "barrier in a launch without fibers");
        return;
    }
    running->barrier = number;
    running->line = line;
    pause_in(AT_BARRIER);
}
uint64_t emu_shuffle(C *c, int mode, uint32_t v, uint32_t b, uint32_t limits, uint32_t mask, int line, uint8_t *p) {
    *p = 1;
    if (!c->fiber) return v;
    Fiber *f = running;
    f->mode = SHUFFLE + mode; f->value = v; f->lane = b; f->limits = limits; f->mask = mask; f->line = line;
    pause_in(IN_WARP);
    *p = f->in_range;
    return f->result;
}
uint32_t emu_vote(C *c, int mode, int p, uint32_t mask, int line) {
    if (!c->fiber) return mode == VOTE_UNIFORM ? 1 : mode > VOTE_BALLOT ? 0 : !!p;
    Fiber *f = running;
    f->mode = mode; f->vote = !!p; f->mask = mask; f->line = line;
    pause_in(IN_WARP);
    return f->result;
}

static void answer_shuffle(Fiber *f, int first, int last) {
    int lane = (int)(f - fibers) - first, mode = f->mode - SHUFFLE, b = f->lane & 31;
    int segment = f->limits >> 8 & 31, low = lane & segment, high = low | (f->limits & 31 & ~segment), from;
    if (mode == 0) { from = lane - b; f->in_range = from >= high; }
    else {
        from = mode == 1 ? lane + b : mode == 2 ? lane ^ b : low | (b & ~segment);
        f->in_range = from <= high;
    }
    if (!f->in_range) from = lane;
    f->result = first + from < last ? fibers[first + from].value : f->value;
}
static void answer_vote(Fiber *f, int first, int last) {
    uint32_t ballot = 0, members = 0;
    for (int k = first; k < last; ++k) {
        uint32_t bit = 1u << (k - first);
        if (fibers[k].state != IN_WARP || !(f->mask & bit)) continue;
        members |= bit;
        if (fibers[k].vote) ballot |= bit;
    }
    f->result = f->mode == VOTE_BALLOT ? ballot : f->mode == VOTE_ALL ? ballot == members : f->mode == VOTE_ANY ? !!ballot
              : f->mode == VOTE_UNIFORM ? !ballot || ballot == members : 0;
}
/* Answers the lanes of a warp of which all that their mask names have come; whether there were any. */
static int answer_warp(int first, int last) {
    uint32_t waiting = 0, done = 0, answered = 0;
    for (int k = first; k < last; ++k) {
        if (fibers[k].state == IN_WARP) waiting |= 1u << (k - first);
        if (fibers[k].state == DONE) done |= 1u << (k - first);
    }
    uint32_t lanes = last - first == WARP ? ~0u : (1u << (last - first)) - 1;
    for (int k = first; k < last; ++k) {
        Fiber *f = fibers + k;
        if (f->state != IN_WARP || (f->mask & lanes & ~(waiting | done))) continue;
        for (int j = first; j < last; ++j) /* its group waits for the same thing */
            if ((f->mask >> (j - first) & 1) && fibers[j].state == IN_WARP && (fibers[j].mode >= SHUFFLE) != (f->mode >= SHUFFLE))
                emu_trap(&f->c, f->line, "deadlock: lanes of a warp wait for different things");
        if (f->mode == VOTE_NONE) { ++f->c.warp_epoch; f->c.members = f->mask; }
        if (f->mode >= SHUFFLE) answer_shuffle(f, first, last);
        else answer_vote(f, first, last);
        answered |= 1u << (k - first);
    }
    for (int k = first; k < last; ++k)
        if (answered >> (k - first) & 1) fibers[k].state = READY;
    return !!answered;
}
/* Lets threads through a barrier at which all that are not done wait; whether there was one. */
static int open_barrier(int count) {
    Fiber *first = 0;
    for (int k = 0; k < count; ++k) {
        Fiber *f = fibers + k;
        if (f->state == DONE) continue;
        if (f->state != AT_BARRIER) return 0;
        if (first && f->barrier != first->barrier) return 0;
        first = first ? first : f;
    }
    for (int k = 0; k < count; ++k)
        if (fibers[k].state == AT_BARRIER) { fibers[k].state = READY; ++fibers[k].c.epoch; }
    return !!first;
}
static void start_fibers(C *base, int count) {
    if (fiber_room < count) {
        fibers = realloc(fibers, count * sizeof(Fiber));
        for (int k = fiber_room; k < count; ++k)
            fibers[k].stack = mmap(0, STACK, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
        fiber_room = count;
    }
    for (int k = 0; k < count; ++k) {
        Fiber *f = fibers + k;
        f->c = *base;
        f->c.fiber = f;
        f->state = READY;
        f->c.tid[0] = k % base->ntid[0];
        f->c.tid[1] = k / base->ntid[0] % base->ntid[1];
        f->c.tid[2] = k / base->ntid[0] / base->ntid[1];
        f->c.thread = base->thread + k;
        f->c.stack_top = (uint64_t)f->stack + STACK;
        getcontext(&f->context);
        f->context.uc_stack.ss_sp = f->stack;
        f->context.uc_stack.ss_size = STACK;
        f->context.uc_link = &scheduler;
        makecontext(&f->context, fiber_main, 0);
    }
}
static void run_block(C *base, int count, const int *order) {
    start_fibers(base, count);
    for (;;) {
        int progress = 0, done = 0;
        for (int k = 0; k < count; ++k) {
            Fiber *f = fibers + order[k];
            if (f->state != READY) continue;
            running = f;
            swapcontext(&scheduler, &f->context);
            progress = 1;
        }
        for (int first = 0; first < count; first += WARP)
            progress |= answer_warp(first, first + WARP < count ? first + WARP : count);
        for (int k = 0; k < count; ++k) done += fibers[k].state == DONE;
        if (done == count) return;
        progress |= open_barrier(count);
        if (!progress)
            for (int k = 0; k < count; ++k)
                if (fibers[k].state != DONE) emu_trap(&fibers[k].c, fibers[k].line, "deadlock: threads wait at different barriers");
    }
}

static uint64_t random_bits(uint64_t *s) { /* splitmix64 */
    uint64_t z = (*s += 0x9e3779b97f4a7c15ull);
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9ull;
    z = (z ^ z >> 27) * 0x94d049bb133111ebull;
    return z ^ z >> 31;
}
static int *permutation(int n, uint64_t seed, uint64_t *state) { /* seed 0: as they are */
    int *p = malloc(n * sizeof *p);
    for (int k = 0; k < n; ++k) p[k] = k;
    for (int k = n - 1; seed && k > 0; --k) {
        int j = random_bits(state) % (k + 1), t = p[k];
        p[k] = p[j];
        p[j] = t;
    }
    return p;
}
static char shared[SHARED_BYTES] __attribute__((aligned(1024)));

/* Runs all threads of a grid; 0, or the code of CUDA's error, of which emu_message() says more. */
int emu_launch(void (*kernel)(C *, void **), const char *name, void **params, const uint32_t *grid, const uint32_t *block,
               uint32_t shared_static, uint32_t shared_dynamic, uint64_t seed, int barrier) {
    int blocks = grid[0] * grid[1] * grid[2], threads = block[0] * block[1] * block[2];
    uint64_t state = seed;
    int *volatile block_order = permutation(blocks, seed, &state), *volatile thread_order = permutation(threads, seed, &state);
    C c;
    memset(&c, 0, sizeof c);
    emu_kernel_name = name;
    message[0] = 0;
    ++emu_launch_number;
    int code = setjmp(escape);
    for (int i = 0; !code && i < blocks; ++i) {
        int b = block_order[i];
        for (int k = 0; k < 3; ++k) { c.ntid[k] = block[k]; c.nctaid[k] = grid[k]; }
        c.ctaid[0] = b % grid[0]; c.ctaid[1] = b / grid[0] % grid[1]; c.ctaid[2] = b / grid[0] / grid[1];
        c.smem = shared; c.smem_static = shared_static; c.smem_dynamic = shared_dynamic;
        c.stack_top = (uint64_t)__builtin_frame_address(0) + 65536;
        memset(shared, 0xff, shared_static + shared_dynamic);
        if (barrier && threads > 1) {
            fiber_kernel = kernel;
            fiber_params = params;
            c.thread = 1 + b * threads;
            if (emu_counting) emu_count_begin();
            run_block(&c, threads, thread_order);
            if (emu_counting && !emu_count_warp(threads)) emu_trap(&c, 0, "the course of a warp was not understood");
            continue;
        }
        for (int j = 0; j < threads; ++j) {
            int t = emu_counting ? j : thread_order[j]; /* lanes of a warp in a row */
            if (emu_counting && j % WARP == 0) emu_count_begin();
            c.tid[0] = t % block[0]; c.tid[1] = t / block[0] % block[1]; c.tid[2] = t / block[0] / block[1];
            c.thread = 1 + b * threads + t;
            kernel(&c, params);
            if (emu_counting && (j % WARP == WARP - 1 || j == threads - 1) && !emu_count_warp(j % WARP + 1))
                emu_trap(&c, 0, "the course of a warp was not understood");
        }
    }
    free(block_order);
    free(thread_order);
    return code;
}

/* Arguments lie one after the other, aligned to their size. */
uint32_t emu_vprintf(C *c, uint64_t format, uint64_t arguments) {
    const char *f = (const char *)(EMU_IS_DEVICE(format) ? format + EMU_DELTA : format), *a = (const char *)arguments;
    size_t offset = 0;
    char part[32];
    for (; *f; ++f) {
        if (*f != '%') { putchar(*f); continue; }
        int k = 0, longs = 0;
        part[k++] = *f++;
        while (*f && strchr("0123456789.-+ #l", *f) && k < 30) { longs += *f == 'l'; part[k++] = *f++; }
        part[k++] = *f;
        part[k] = 0;
        if (*f == '%') { putchar('%'); continue; }
        int wide = longs || strchr("fgeFGEps", *f);
        offset = wide ? (offset + 7) & ~7ul : (offset + 3) & ~3ul;
        if (strchr("fgeFGE", *f)) { double v; memcpy(&v, a + offset, 8); printf(part, v); }
        else if (wide) {
            uint64_t v;
            memcpy(&v, a + offset, 8);
            if (*f == 's') printf(part, (char *)(EMU_IS_DEVICE(v) ? v + EMU_DELTA : v));
            else printf(part, v);
        }
        else { int v; memcpy(&v, a + offset, 4); printf(part, v); }
        offset += wide ? 8 : 4;
    }
    fflush(stdout);
    return 0;
}
