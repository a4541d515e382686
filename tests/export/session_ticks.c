/* What a leader and a follower hear and do, read from the input one by one; what comes of each tick, to the output.

   Each begins with a letter: L or F, a struct as Python has it; l or f, the same as its init function makes it; h or a,
   telemetry or a model for the leader; t, its tick; c, a command for the follower; s, its tick with a sample. With
   "shown" no messages are written, only what the ticks come to; with "structs" both structs, in the end, too; with
   "times" nothing but how long each tick of the leader takes [ns]. */
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "foretouch_session.h"

enum { ASSUMED = 1000 }; /* bytes that a model is taken to have, where no message is written */

static enum { MESSAGES, SHOWN, TIMES, STRUCTS } written;
static foretouch_leader leader;
static foretouch_follower follower;
static uint8_t bytes[FORETOUCH_LARGEST_MESSAGE];

static void get(void *place, size_t size)
{
    if (size > 0 && fread(place, 1, size, stdin) != size) {
        abort();
    }
}

static void put(const void *place, size_t size)
{
    fwrite(place, 1, size, stdout);
}

static void put_message(size_t size)
{
    uint32_t length = (uint32_t)size;
    put(&length, sizeof length);
    put(bytes, size);
}

static int64_t clock_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

static double number(void)
{
    double value;
    get(&value, sizeof value);
    return value;
}

static int64_t whole(void)
{
    int64_t value;
    get(&value, sizeof value);
    return value;
}

static bool flag(void)
{
    return getchar() == 1;
}

static size_t message(void)
{
    uint32_t size;
    get(&size, sizeof size);
    if (size > sizeof bytes) {
        abort();
    }
    get(bytes, size);
    return size;
}

static void tick_leader(void)
{
    int64_t now = whole();
    double hand = number();
    int64_t period = whole();
    bool clutched = flag(), stopping = flag();
    int64_t begun = clock_ns();
    double force = foretouch_leader_tick(&leader, now, hand, period, clutched, stopping);
    int64_t took = clock_ns() - begun;
    if (memcmp(&force, &leader.shown.rendered_force, sizeof force) != 0) {
        abort();
    }
    if (written == TIMES) {
        put(&took, sizeof took);
        return;
    }
    put(&leader.shown, sizeof leader.shown);
    if (written == MESSAGES) {
        put_message(foretouch_leader_command(&leader, "anna", bytes, sizeof bytes));
    }
}

static void tick_follower(void)
{
    foretouch_sample sample;
    sample.position = number();
    sample.sensor_force = number();
    sample.acceleration = number();
    sample.exact_force = number();
    sample.exact_position = number();
    sample.commanded_position = number();
    sample.clipped = flag();
    sample.effort = number();
    int64_t now = whole(), period = whole(), compute = whole();
    bool stop = flag(), release = flag(), ended = flag();
    foretouch_follower_tick(&follower, &sample, now, period, stop, release, ended);
    if (written == TIMES) {
        return;
    }
    put(&follower.shown, sizeof follower.shown);
    if (written == SHOWN) {
        if (foretouch_follower_publish(&follower, now)) {
            put(&follower.published[0], offsetof(foretouch_published, sent));
            foretouch_follower_published(&follower, ASSUMED);
        }
        return;
    }
    put_message(foretouch_follower_model(&follower, now, bytes, sizeof bytes));
    put_message(foretouch_follower_telemetry(&follower, &sample, now, period, compute, bytes, sizeof bytes));
}

int main(int count, char **words)
{
    static const char *const choices[] = {"messages", "shown", "times", "structs"};
    for (int choice = MESSAGES; count > 1 && choice <= STRUCTS; choice++) {
        written = strcmp(words[1], choices[choice]) == 0 ? choice : (int)written;
    }
    for (int letter = getchar(); letter != EOF; letter = getchar()) {
        size_t size;
        int64_t now;
        switch (letter) {
        case 'L':
            get(&leader, sizeof leader);
            break;
        case 'F':
            get(&follower, sizeof follower);
            break;
        case 'l':
            foretouch_leader_init(&leader);
            foretouch_leader_start(&leader, 1);
            break;
        case 'f':
            foretouch_follower_init(&follower);
            foretouch_follower_start(&follower, 1);
            break;
        case 'h':
            size = message();
            foretouch_leader_hear(&leader, bytes, size);
            break;
        case 'a':
            size = message();
            foretouch_leader_adopt(&leader, bytes, size);
            break;
        case 'c':
            now = whole();
            size = message();
            foretouch_follower_take(&follower, bytes, size, now, NULL);
            break;
        case 't':
            tick_leader();
            break;
        case 's':
            tick_follower();
            break;
        default:
            abort();
        }
    }
    if (written == STRUCTS) {
        put(&leader, sizeof leader);
        put(&follower, sizeof follower);
    }
    return 0;
}
