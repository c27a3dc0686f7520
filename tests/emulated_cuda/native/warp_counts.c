/* Counts what warps do. Threads run one after the other; each writes down the blocks that it passes and the global memory
   that it accesses. From the 32 logs the warp's own course follows: lanes at one block issue its instructions once, lanes
   that part at a branch go one group after the other up to the block where they meet again. */
#define EMU_RUNTIME
#include "warp_counts.h"
#include <stdio.h>
#include <stdlib.h>

#define WARP 32
#define SECTOR_BITS 5 /* 32 bytes */
#define LINE_SECTORS 4
#define REQUEST_LINES 512

typedef struct Entry { uint32_t site, size; uint64_t address; } Entry; /* size 0: block `site`; else line << 1 | store */
typedef struct Log { Entry *at, *end, *start; } Log;
static Log logs[WARP];
static Entry *place[WARP];
static const int32_t *meeting, *after_call; /* of the module, per block */
static const uint32_t *weights;             /* per block: instructions by class, rounds, cycles */
static int classes;
static uint64_t *sums; /* of the kernel: as the enumeration says, then instructions by class */
enum { WARPS, SLOTS, LANE_SLOTS, LONGEST_LANE, ROUNDS, CYCLES, LOADS, LOAD_SECTORS, STORES, STORE_SECTORS, L1_MISSES, L2_MISSES, WRITTEN_BACK, FIRST_CLASS };

int emu_counting;

/* Counts launches from now on, or none where `into` is null. */
void emu_count_into(uint64_t *into, const int32_t *meet, const int32_t *after, const uint32_t *weight, int class_count) {
    sums = into; meeting = meet; after_call = after; weights = weight; classes = class_count;
    emu_counting = into != 0;
}

static void note(C *c, uint32_t site, uint32_t size, uint64_t address) {
    Log *log = &logs[(c->thread - 1) % WARP];
    if (log->at == log->end) {
        size_t used = log->at - log->start, room = used ? 2 * used : 1 << 14;
        log->start = realloc(log->start, room * sizeof(Entry));
        log->at = log->start + used;
        log->end = log->start + room;
    }
    *log->at++ = (Entry){site, size, address};
}
void emu_block(C *c, uint32_t block) {
    if (emu_counting) note(c, block, 0, 0);
}
void emu_access(C *c, int line, int access, uint32_t size, uint64_t address) {
    note(c, (uint32_t)line << 1 | (access != 0), size, address);
}

/* Caches: sets of lines of 128 bytes with a bit per sector; the line that was used longest ago goes. */
typedef struct { uint64_t tag, used; uint8_t valid, dirty; } Line;
typedef struct { Line *lines; uint64_t sets, ways, clock; } Cache;
static Cache l1, l2;
static void open_cache(Cache *k, uint64_t bytes, uint64_t ways) {
    free(k->lines);
    k->ways = ways;
    k->sets = bytes / (ways * LINE_SECTORS << SECTOR_BITS);
    if (!k->sets) k->sets = 1;
    k->lines = calloc(k->sets * ways, sizeof(Line));
    k->clock = 0;
}
/* Bytes of a warp's share of the first cache, and of the second one. */
void emu_count_caches(uint64_t first, uint64_t second) {
    open_cache(&l1, first, 4);
    open_cache(&l2, second, 16);
}
/* Sectors of `mask` that were not there. `written` grows by the changed sectors of a line that has to go. */
static int touch(Cache *k, uint64_t tag, int mask, int store, uint64_t *written) {
    uint64_t hash = tag * 0x9e3779b97f4a7c15ull;
    Line *set = k->lines + (hash >> 20) % k->sets * k->ways, *oldest = set;
    ++k->clock;
    for (uint64_t i = 0; i < k->ways; ++i) {
        Line *line = set + i;
        if (line->valid && line->tag == tag) {
            int missing = mask & ~line->valid;
            line->used = k->clock;
            line->valid |= mask;
            if (store) line->dirty |= mask;
            return missing;
        }
        if (line->used < oldest->used) oldest = line;
    }
    if (oldest->valid) *written += __builtin_popcount(oldest->dirty);
    *oldest = (Line){tag, k->clock, mask, store ? mask : 0};
    return mask;
}

/* The block or access that a lane comes to next; a lane at its end stands at block RETURN. */
#define RETURN -1
static int is_access(int lane) { return place[lane] < logs[lane].at && place[lane]->size; }
static int32_t block_of(int lane) { return place[lane] < logs[lane].at ? (int32_t)place[lane]->site : RETURN; }

/* One request of the lanes in `mask`, which stand at the same access. Stores go through the first cache. */
static void request(uint32_t mask, int store) {
    struct { uint64_t tag; int mask; } lines[REQUEST_LINES];
    int count = 0;
    for (int i = 0; i < WARP; ++i) {
        if (!(mask >> i & 1)) continue;
        uint64_t first = place[i]->address >> SECTOR_BITS, last = (place[i]->address + place[i]->size - 1) >> SECTOR_BITS;
        ++place[i];
        for (uint64_t sector = first; sector <= last; ++sector) {
            int j = 0;
            while (j < count && lines[j].tag != sector / LINE_SECTORS) ++j;
            if (j == count) { lines[j].tag = sector / LINE_SECTORS; lines[j].mask = 0; ++count; }
            lines[j].mask |= 1 << sector % LINE_SECTORS;
        }
    }
    ++sums[store ? STORES : LOADS];
    for (int j = 0; j < count; ++j) {
        uint64_t none = 0;
        sums[store ? STORE_SECTORS : LOAD_SECTORS] += __builtin_popcount(lines[j].mask);
        int missing = store ? lines[j].mask : touch(&l1, lines[j].tag, lines[j].mask, 0, &none);
        if (!missing) continue;
        int absent = touch(&l2, lines[j].tag, missing, store, &sums[WRITTEN_BACK]);
        if (store) continue;
        sums[L1_MISSES] += __builtin_popcount(missing);
        sums[L2_MISSES] += __builtin_popcount(absent);
    }
}

/* The lanes in `mask` issue the block at which they stand. */
static void issue(int32_t block, uint32_t mask) {
    const uint32_t *weight = weights + (size_t)block * (classes + 2);
    uint64_t slots = 0;
    for (int k = 0; k < classes; ++k) { sums[FIRST_CLASS + k] += weight[k]; slots += weight[k]; }
    sums[SLOTS] += slots;
    sums[LANE_SLOTS] += slots * __builtin_popcount(mask);
    sums[ROUNDS] += weight[classes];
    sums[CYCLES] += weight[classes + 1] > slots ? weight[classes + 1] : slots;
    for (int i = 0; i < WARP; ++i)
        if (mask >> i & 1) ++place[i];
    for (;;) { /* accesses, in the order of the text: lanes of which a guard holds some back access together */
        uint32_t site = ~0u, together = 0;
        int store = 0;
        for (int i = 0; i < WARP; ++i)
            if (mask >> i & 1 && is_access(i) && (place[i]->site >> 1) < site) { site = place[i]->site >> 1; store = place[i]->site & 1; }
        for (int i = 0; i < WARP; ++i)
            if (mask >> i & 1 && is_access(i) && place[i]->site >> 1 == site) together |= 1u << i;
        if (!together) return;
        request(together, store);
    }
}

/* Lanes that stand at one block go on, up to block `stop`; `back` follows the function that they are in. */
static void walk(uint32_t mask, int32_t stop, int32_t back) {
    while (mask) {
        int32_t block = block_of(__builtin_ctz(mask));
        if (block == stop || block == RETURN) return;
        issue(block, mask);
        if (after_call[block] >= 0) {
            walk(mask, after_call[block], after_call[block]);
            continue;
        }
        int32_t next = block_of(__builtin_ctz(mask)), meet = meeting[block] == RETURN ? back : meeting[block];
        int parted = 0;
        for (int i = 0; i < WARP; ++i) parted |= (mask >> i & 1) && block_of(i) != next;
        if (!parted) continue;
        for (uint32_t left = mask; left;) {
            uint32_t group = 0;
            next = block_of(__builtin_ctz(left));
            for (int i = 0; i < WARP; ++i)
                if (left >> i & 1 && block_of(i) == next) group |= 1u << i;
            left &= ~group;
            if (next != meet) walk(group, meet, back);
        }
        for (int i = 0; i < WARP; ++i)
            if (block_of(i) == RETURN) mask &= ~(1u << i);
    }
}

void emu_count_begin(void) {
    for (int i = 0; i < WARP; ++i) logs[i].at = logs[i].start;
}
/* Counts the warp whose lanes have run; 0 where a lane's log was not understood to its end. */
int emu_count_warp(int lanes) {
    uint64_t longest = 0;
    memset(l1.lines, 0, l1.sets * l1.ways * sizeof(Line));
    for (int i = 0; i < WARP; ++i) {
        uint64_t slots = 0;
        place[i] = logs[i].start;
        for (Entry *entry = logs[i].start; i < lanes && entry < logs[i].at; ++entry)
            for (int k = 0; !entry->size && k < classes; ++k) slots += weights[(size_t)entry->site * (classes + 2) + k];
        if (slots > longest) longest = slots;
    }
    ++sums[WARPS];
    sums[LONGEST_LANE] += longest;
    walk(lanes == WARP ? ~0u : (1u << lanes) - 1, RETURN, RETURN);
    for (int i = 0; i < lanes; ++i)
        if (place[i] != logs[i].at) return 0;
    return 1;
}
