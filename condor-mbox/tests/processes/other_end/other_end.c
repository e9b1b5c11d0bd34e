/* Processor 1 of a system of two, written after LAYOUT.md alone: it doubles what is sent to vector
 * 5, and for vector 6 asks processor 0 back. `other_end DIRECTORY` runs until it is sent a 0 to
 * vector 7, or its peer is gone. */
#define _GNU_SOURCE
#include <fcntl.h>
#include <linux/futex.h>
#include <sched.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

enum { N = 2, ME = 1, PEER = 0, SLOTS = 8, VECTORS = 64 };
enum { SEND = 1, CALL = 2 };
enum { DONE = 1, NO_HANDLER = 2 };
#define JOINING 0xFFFFFFFFu

typedef _Atomic uint32_t word;
struct entry { word value, epoch, kind, sequence; };
struct pair {
    word acknowledged, taken, unused[14];
    struct entry slots[SLOTS], cells[SLOTS];
};
struct mail {
    word magic, version, processors, number, slots, vectors, data_size, incarnation, last_incarnation, listeners;
    word process_id, unused[5];
    word heartbeat, unused_1[15];
    word notify, unused_2[15];
    word listening[16]; /* 8 * N bytes, rounded up to a line */
    struct { word name[8], sent, handled, failed, worst; } table[VECTORS];
    struct pair pairs[N];
};
_Static_assert(sizeof(struct mail) == 3968, "the size that LAYOUT.md gives");

static struct mail *mine, *theirs;
static word *their_data;
static uint32_t my_incarnation, their_incarnation;
static uint32_t head, tail; /* latest sent, latest taken */
static bool stop;

#define load(at) atomic_load_explicit(at, memory_order_relaxed)
#define store(at, value) atomic_store_explicit(at, value, memory_order_relaxed)
#define load_acquire(at) atomic_load_explicit(at, memory_order_acquire)
#define store_release(at, value) atomic_store_explicit(at, value, memory_order_release)

static void put(struct entry *e, uint32_t sequence, uint32_t epoch, uint32_t kind, uint32_t value)
{
    store(&e->sequence, sequence - 1);
    store_release(&e->epoch, epoch);
    atomic_thread_fence(memory_order_release);
    store(&e->value, value);
    store(&e->kind, kind);
    store_release(&e->sequence, sequence);
}

static bool get(struct entry *e, uint32_t sequence, uint32_t *epoch, uint32_t *kind, uint32_t *value)
{
    *epoch = load_acquire(&e->epoch);
    if (load_acquire(&e->sequence) != sequence)
        return false;
    *value = load(&e->value);
    *kind = load(&e->kind);
    atomic_thread_fence(memory_order_acquire);
    return load_acquire(&e->sequence) == sequence && load(&e->epoch) == *epoch;
}

static uint32_t epoch(uint32_t sender, uint32_t receiver)
{
    uint32_t mixed = sender * 0x9E3779B1u + receiver * 0x85EBCA77u;
    return mixed == 0 ? 1 : mixed;
}

static void wake(void)
{
    atomic_thread_fence(memory_order_seq_cst);
    if (load(&theirs->notify) != 0) {
        atomic_fetch_add_explicit(&their_data[0], 1, memory_order_release);
        syscall(SYS_futex, &their_data[0], FUTEX_WAKE, INT32_MAX, NULL, NULL, 0);
    }
}

static void join(uint32_t data_size)
{
    if (load_acquire(&mine->magic) == 0) {
        store(&mine->version, 2);
        store(&mine->processors, N);
        store(&mine->number, ME);
        store(&mine->slots, SLOTS);
        store(&mine->vectors, VECTORS);
        store(&mine->data_size, data_size);
        store_release(&mine->magic, 0x52444E43u);
    }
    store_release(&mine->incarnation, JOINING);
    atomic_thread_fence(memory_order_release);
    my_incarnation = load(&mine->last_incarnation);
    do {
        my_incarnation++;
        if (my_incarnation == 0 || my_incarnation == JOINING)
            my_incarnation = 1;
    } while (my_incarnation == load(&theirs->pairs[ME].acknowledged));
    store(&mine->last_incarnation, my_incarnation);
    for (int q = 0; q < N; q++) {
        struct pair *pair = &mine->pairs[q];
        for (int i = 0; i < SLOTS; i++) {
            store(&pair->slots[i].epoch, 0);
            store(&pair->slots[i].sequence, 0);
            store(&pair->cells[i].epoch, 0);
            store(&pair->cells[i].sequence, 0);
        }
        store(&pair->acknowledged, 0);
        store(&pair->taken, 0);
        store(&mine->listening[2 * q], 0);
    }
    store(&mine->listeners, 0);
    store(&mine->notify, 0);
    store(&mine->table[5].name[0], 0x65637774u); /* "twce" */
    atomic_thread_fence(memory_order_release);
    store(&mine->pairs[ME].acknowledged, my_incarnation);
    store_release(&mine->incarnation, my_incarnation);
    wake();
}

/* Acknowledges what began or ended; false if the peer is not connected. */
static bool notice(void)
{
    uint32_t incarnation = load_acquire(&theirs->incarnation);
    if (incarnation != their_incarnation) {
        their_incarnation = 0;
        if (incarnation != 0 && incarnation != JOINING) {
            if (load_acquire(&theirs->magic) != 0x52444E43u || load(&theirs->version) != 2)
                exit(2);
            their_incarnation = incarnation;
            head = tail = 0;
            for (int i = 0; i < SLOTS; i++) {
                store(&mine->pairs[PEER].slots[i].epoch, 0);
                store(&mine->pairs[PEER].cells[i].epoch, 0);
            }
            store(&mine->pairs[PEER].taken, 0);
            store_release(&mine->pairs[PEER].acknowledged, incarnation);
            wake();
        }
    }
    return their_incarnation != 0 && load_acquire(&theirs->pairs[ME].acknowledged) == my_incarnation;
}

static void serve(void);

/* Asks vector 6 of the peer by the only call that this end makes at a time. */
static uint32_t ask_back(uint32_t data)
{
    uint32_t sequence = head + 1, ours = epoch(my_incarnation, their_incarnation);
    uint32_t asked = their_incarnation;
    uint32_t found, status, value;
    if (sequence - load_acquire(&theirs->pairs[ME].taken) > SLOTS)
        return 0;
    put(&mine->pairs[PEER].slots[sequence % SLOTS], sequence, ours, CALL << 8 | 6 | 3 << 16, data);
    head = sequence;
    wake();
    while (!get(&theirs->pairs[ME].cells[3], sequence, &found, &status, &value) || found != ours) {
        serve();
        sched_yield();
        if (their_incarnation != asked)
            return 0;
    }
    return status == DONE ? value : 0;
}

static void serve(void)
{
    uint32_t found, kind, value;
    store(&mine->heartbeat, load(&mine->heartbeat) + 1);
    if (!notice())
        return;
    uint32_t sequence = tail + 1, incarnation = their_incarnation;
    if (!get(&theirs->pairs[ME].slots[sequence % SLOTS], sequence, &found, &kind, &value)
        || found != epoch(their_incarnation, my_incarnation))
        return;
    tail = sequence;
    store_release(&mine->pairs[PEER].taken, sequence);
    uint32_t status = DONE, reply = 0;
    switch (kind & 0xFF) {
    case 5: reply = 2 * value; break;
    case 6: reply = ask_back(value) + 1; break;
    case 7: stop = true; break;
    default: status = NO_HANDLER;
    }
    if ((kind >> 8 & 0xFF) == CALL && their_incarnation == incarnation)
        put(&mine->pairs[PEER].cells[(kind >> 16) % SLOTS], sequence, found, status, reply);
    wake();
}

static void *map(const char *directory, const char *name, int flags, int *kept, uint32_t *size)
{
    char path[4096];
    struct stat about;
    snprintf(path, sizeof path, "%s/%s", directory, name);
    int file = open(path, flags);
    if (file < 0 || fstat(file, &about) != 0) {
        perror(path);
        exit(1);
    }
    int protection = flags == O_RDONLY ? PROT_READ : PROT_READ | PROT_WRITE;
    void *memory = mmap(NULL, about.st_size, protection, MAP_SHARED, file, 0);
    if (memory == MAP_FAILED) {
        perror(path);
        exit(1);
    }
    *kept = file;
    *size = about.st_size;
    return memory;
}

int main(int count, char **arguments)
{
    int file, held;
    uint32_t size, data_size;
    if (count != 2)
        return 1;
    mine = map(arguments[1], "1.mail", O_RDWR, &held, &size);
    struct flock lock = { .l_type = F_WRLCK, .l_whence = SEEK_SET, .l_len = 1 };
    if (fcntl(held, F_OFD_SETLK, &lock) != 0)
        return 3;
    theirs = map(arguments[1], "0.mail", O_RDONLY, &file, &size);
    map(arguments[1], "1.data", O_RDWR, &file, &data_size);
    their_data = map(arguments[1], "0.data", O_RDWR, &file, &size);
    join(data_size);
    while (!stop) {
        serve();
        sched_yield();
    }
    store_release(&mine->incarnation, 0);
    wake();
    return 0;
}
