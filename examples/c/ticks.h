/* Ticks of a loop, once a millisecond, on a system with POSIX clocks, without any privilege.

   The time of a tick is that of an even grid, so that how late the machine woke is in no velocity; moments that have
   passed are skipped, and not made up for in a burst. The thread sleeps to just before a tick, and waits the rest awake. */

#ifndef TICKS_H
#define TICKS_H

#include <stdint.h>
#include <time.h>

enum { TICK_NS = 1000000, TICK_AWAKE_NS = 150000, TICK_SECOND_NS = 1000000000 };

/* Begins with zeros. */
typedef struct {
    int64_t now;    /* of this tick: a moment of the grid [ns] */
    int64_t woke;   /* when it really began [ns] */
    int64_t period; /* since the last one really began, which a leader and a follower are told [ns] */
} ticks;

static inline int64_t ticks_clock(clockid_t clock)
{
    struct timespec now;
    clock_gettime(clock, &now); /* answered without entering the kernel */
    return (int64_t)now.tv_sec * TICK_SECOND_NS + now.tv_nsec;
}

/* Wait for the next tick; how many periods have passed since the one before, 1 where none was skipped. */
static inline int ticks_wait(ticks *loop)
{
    const int64_t before = loop->woke;
    int64_t woke = ticks_clock(CLOCK_MONOTONIC);
    int skipped = 0;
    loop->now = loop->now == 0 ? woke : loop->now + TICK_NS;
    if (woke > loop->now + TICK_NS) {
        skipped = (int)((woke - loop->now) / TICK_NS);
        loop->now += (int64_t)skipped * TICK_NS;
    }
    const int64_t asleep = loop->now - TICK_AWAKE_NS;
    if (woke < asleep) {
        const struct timespec until = {asleep / TICK_SECOND_NS, asleep % TICK_SECOND_NS};
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL);
    }
    while ((woke = ticks_clock(CLOCK_MONOTONIC)) < loop->now) {
    }
    loop->woke = woke;
    loop->period = before == 0 ? 0 : woke - before;
    return 1 + skipped;
}

/* The number of a process, larger in one that is started later: milliseconds of the wall clock, times 2^21. */
static inline uint64_t ticks_process(void)
{
    return (uint64_t)(ticks_clock(CLOCK_REALTIME) / 1000000) << 21;
}

#endif
