/* The limit of pacing: how late does a plain C loop wake up on an absolute schedule?
 *
 *   pacing CORE POLICY PRIORITY PERIOD_NS WARMUP COUNT
 *
 * CORE -1: not pinned. POLICY: "fifo" or "other". Sleeps with clock_nanosleep(TIMER_ABSTIME), as
 * cyclictest does, with locked memory where permitted and the smallest timer slack. A wake-up later
 * than the next instant skips the instants that have passed. Writes COUNT + 3 int64 to standard
 * output: the lateness of each wake-up in ns, then the instants skipped, the processor time used
 * and the time that passed, in ns. Exit status 2: wrong arguments, 3: refused by the system.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <sched.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <time.h>

static int64_t now(clockid_t clock)
{
    struct timespec t;
    clock_gettime(clock, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

static int refused(const char *what)
{
    perror(what);
    return 3;
}

int main(int argc, char **argv)
{
    if (argc != 7) {
        fprintf(stderr, "pacing CORE POLICY PRIORITY PERIOD_NS WARMUP COUNT\n");
        return 2;
    }
    const int core = atoi(argv[1]);
    const int fifo = !strcmp(argv[2], "fifo");
    const struct sched_param priority = {.sched_priority = fifo ? atoi(argv[3]) : 0};
    const int64_t period = atoll(argv[4]);
    const long warmup = atol(argv[5]), count = atol(argv[6]);
    int64_t *late = calloc(count + 3, sizeof *late);
    if (!late || period < 1 || count < 1)
        return 2;
    if (core >= 0) {
        cpu_set_t cores;
        CPU_ZERO(&cores);
        CPU_SET(core, &cores);
        if (sched_setaffinity(0, sizeof cores, &cores))
            return refused("sched_setaffinity");
    }
    if (sched_setscheduler(0, fifo ? SCHED_FIFO : SCHED_OTHER, &priority))
        return refused("sched_setscheduler");
    mlockall(MCL_CURRENT | MCL_FUTURE); /* not permitted everywhere; the loop touches little */
    prctl(PR_SET_TIMERSLACK, 1UL);

    int64_t skipped = 0, used = 0, started = 0;
    int64_t next = now(CLOCK_MONOTONIC) + period;
    for (long i = -warmup; i < count; i++) {
        if (i == 0) {
            skipped = 0;
            used = now(CLOCK_PROCESS_CPUTIME_ID);
            started = now(CLOCK_MONOTONIC);
        }
        const struct timespec until = {next / 1000000000, next % 1000000000};
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL) == EINTR)
            ;
        const int64_t lateness = now(CLOCK_MONOTONIC) - next;
        if (i >= 0)
            late[i] = lateness;
        skipped += lateness / period;
        next += period * (1 + lateness / period);
    }
    late[count] = skipped;
    late[count + 1] = now(CLOCK_PROCESS_CPUTIME_ID) - used;
    late[count + 2] = now(CLOCK_MONOTONIC) - started;
    return fwrite(late, sizeof *late, count + 3, stdout) == (size_t)count + 3 ? 0 : 1;
}
