/* A leader in C: a hand by script presses what a follower in Python presses, over `foretouch gate`.

       foretouch follower --listen tcp/127.0.0.1:7447 --position-delay 0.08 --jitter 0.02 --loss 0.05
       foretouch gate --connect tcp/127.0.0.1:7447 --delay 0.08 --jitter 0.02 --loss 0.05
       ./leader 127.0.0.1 7460 10

   A real one reads its device in place of `hand_at`, and gives it the force in place of printing it. */

#define _POSIX_C_SOURCE 200809L

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "foretouch_session.h"
#include "gate.h"
#include "ticks.h"

enum { SECOND = 1000, RING = 4096 };

static foretouch_leader leader;
static gate network;
static int64_t sent_ns[RING]; /* when each of the newest commands was sent */

/* Position of the hand [m], which begins at 0, wherever the robot is: close to the surface in a second, and from then on
   10 mm in and out again, once in two seconds. */
static double hand_at(double time)
{
    const double turn = 6.283185307179586, near = 0.007, press = 0.010;
    if (time < 1.0) {
        return near * 0.5 * (1.0 - cos(0.5 * turn * time));
    }
    return near + press * 0.5 * (1.0 - cos(turn * (time - 1.0) / 2.0));
}

/* What has come, and what is printed of it. */
struct heard {
    double force;         /* at the robot, one way ago [N] */
    double largest_force; /* felt so far [N] */
    double round_trip_ms; /* of the newest command that an answer names */
    uint64_t status;      /* of the follower */
    bool stopped;         /* whether the session has ended */
};

static void hear(struct heard *heard, int64_t now)
{
    foretouch_channel channel;
    const uint8_t *message;
    size_t size;
    foretouch_telemetry telemetry;
    while (gate_take(&network, &channel, &message, &size)) {
        if (channel == FORETOUCH_CHANNEL_MODEL) {
            foretouch_leader_adopt(&leader, message, size);
        } else if (channel == FORETOUCH_CHANNEL_TELEMETRY) {
            foretouch_leader_hear(&leader, message, size);
            if (foretouch_telemetry_decode(message, size, &telemetry) == FORETOUCH_OK) {
                heard->force = telemetry.force;
                heard->status = telemetry.status;
                if (telemetry.epoch == (uint64_t)leader.views[0].epoch && telemetry.command_sequence > 0) {
                    heard->round_trip_ms = 1e-6 * (double)(now - sent_ns[telemetry.command_sequence % RING]);
                }
            }
        } else if (channel == FORETOUCH_CHANNEL_STOP) {
            heard->stopped = true;
        }
    }
}

/* The command for the follower, and the record for whoever watches: console, recorder and report. */
static void say(double hand, double delayed_force, const ticks *loop, int64_t computed)
{
    const foretouch_shown *shown = &leader.shown;
    uint8_t bytes[FORETOUCH_LEADER_STATE_ROOM];
    foretouch_leader_state state;
    sent_ns[(uint64_t)leader.sequence % RING] = loop->woke;
    gate_send(&network, FORETOUCH_CHANNEL_COMMAND, bytes, foretouch_leader_command(&leader, "leader.c", bytes, sizeof bytes));
    foretouch_leader_state_init(&state);
    state.sequence = (uint64_t)leader.sequence;
    state.time_ns = (uint64_t)loop->now;
    state.position = shown->position;
    state.velocity = shown->velocity;
    state.predicted_force = shown->predicted_force;
    state.rendered_force = shown->rendered_force;
    state.delayed_force = delayed_force;
    state.telemetry_sequence = (uint64_t)leader.views[0].newest_telemetry;
    state.model_sequence = (uint64_t)leader.views[0].newest_model;
    state.model_jump = shown->jump;
    state.clipped = shown->clipped;
    state.period_ns = (uint64_t)loop->period;
    state.compute_ns = (uint64_t)computed;
    state.standard_deviation = shown->standard_deviation;
    state.hand_position = hand;
    state.mediated_force = shown->mediated_force;
    state.update_step = shown->step_by_models;
    state.energy = shown->energy;
    state.energy_bound = shown->energy_bound;
    state.late_energy = shown->late_energy;
    state.rendered_share = shown->rendered_share;
    state.engaged = shown->engaged;
    state.epoch = (uint64_t)leader.views[0].epoch;
    state.run = (uint64_t)leader.views[0].run;
    gate_send(&network, FORETOUCH_CHANNEL_LEADER, bytes, foretouch_leader_state_encode(&state, bytes, sizeof bytes));
}

/* End the session in order: the follower lets go of what it presses. */
static void end(void)
{
    uint8_t bytes[FORETOUCH_STOP_ROOM];
    foretouch_stop stop;
    foretouch_stop_init(&stop);
    stop.sequence = 1;
    stop.time_ns = (uint64_t)ticks_clock(CLOCK_MONOTONIC);
    stop.reason = foretouch_text_of("the leader's time is over");
    stop.epoch = (uint64_t)leader.views[0].epoch;
    gate_send(&network, FORETOUCH_CHANNEL_STOP, bytes, foretouch_stop_encode(&stop, bytes, sizeof bytes));
}

int main(int count, char **words)
{
    const char *address = count > 1 ? words[1] : "127.0.0.1";
    const int port = count > 2 ? atoi(words[2]) : 7460, ticks_wanted = SECOND * (count > 3 ? atoi(words[3]) : 10);
    struct heard heard = {0};
    double lowest_margin = INFINITY;
    if (!gate_open(&network, address, (uint16_t)port)) {
        fprintf(stderr, "leader: no gate at %s:%d\n", address, port);
        return 1;
    }
    foretouch_leader_init(&leader);
    foretouch_leader_start(&leader, ticks_process());
    printf("   time    hand  felt  robot  round trip  status\n     [s]    [mm]   [N]    [N]        [ms]\n");
    ticks loop = {0};
    int64_t computed = 0;
    for (int tick = 0, shown = 0; tick < ticks_wanted && gate_is_open(&network) && !heard.stopped;) {
        tick += ticks_wait(&loop);
        const double hand = hand_at(1e-3 * tick);
        hear(&heard, loop.woke);
        const double force = foretouch_leader_tick(&leader, loop.now, hand, loop.period, false, false);
        say(hand, heard.force, &loop, computed);
        computed = ticks_clock(CLOCK_MONOTONIC) - loop.woke;
        heard.largest_force = fmax(heard.largest_force, force);
        lowest_margin = fmin(lowest_margin, leader.shown.energy + leader.shown.energy_bound);
        if (tick / (SECOND / 2) > shown) {
            shown = tick / (SECOND / 2);
            printf("%8.1f  %6.1f  %4.1f  %5.1f  %10.1f  %6d\n", 1e-3 * tick, 1e3 * hand, force, heard.force,
                heard.round_trip_ms, (int)heard.status);
            fflush(stdout);
        }
    }
    end();
    printf("largest force felt: %.2f N\nmodels refused: %lld\nleast energy above its bound: %.2e J\n",
        heard.largest_force, (long long)leader.refused, lowest_margin);
    gate_close(&network);
    return 0;
}
