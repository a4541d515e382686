/* What a leader and a follower hear and do, read from the input one by one; what comes of each tick, to the output.

   Each begins with a letter: L or F, a struct as Python has it; l or f, the same as its init function makes it; h or a,
   telemetry or a model for the leader; t, its tick; c, a command for the follower; s, its tick with a sample. With
   "shown" no messages are written, only what the ticks come to. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "foretouch_session.h"

enum { ASSUMED = 1000 }; /* bytes that a model is taken to have, where no message is written */

static foretouch_leader leader;
static foretouch_follower follower;
static uint8_t bytes[FORETOUCH_LARGEST_MESSAGE];
static int shown_alone;

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
    double force = foretouch_leader_tick(&leader, now, hand, period, clutched, stopping);
    if (memcmp(&force, &leader.shown.rendered_force, sizeof force) != 0) {
        abort();
    }
    put(&leader.shown, sizeof leader.shown);
    if (!shown_alone) {
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
    put(&follower.shown, sizeof follower.shown);
    if (shown_alone) {
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
    shown_alone = count > 1 && strcmp(words[1], "shown") == 0;
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
            foretouch_leader_start(&leader, 11);
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
    return 0;
}
