/* What the page's worker calls: one session and one recording, in static memory, by plain numbers.

   Times come in whole milliseconds, for a number of JavaScript holds no nanoseconds of a day. */

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "foretouch_session.h"

#define EXPORT(name) __attribute__((export_name(#name))) name
#define HOLDER "page"
#define MS 1000000

enum { TIME, AIM, HAND, PROXY, FELT, PREDICTED, ARRIVED, LATE, ROBOT, TRUE, COLUMNS };

static foretouch_leader leader;
static foretouch_follower follower;
static foretouch_slide slide;
static foretouch_hand hand;
static foretouch_delaying delaying;
static foretouch_trial trial;
static foretouch_follower fresh_follower; /* of which a recording takes what it begins with */
static foretouch_leader fresh_leader;
static foretouch_sample sample;
static uint8_t bytes[FORETOUCH_LARGEST_MESSAGE];
static double shown[COLUMNS];
static double aim, force, force_before, desired;
static bool held;

/* ---- Beginning ---- */

static void (*const materials[])(foretouch_slide *) = {@MATERIALS@};

/* A leader that knows nothing yet; one with a higher epoch takes over from the one before. */
void EXPORT(page_start_leader)(double epoch)
{
    foretouch_leader_held_init(&leader);
    foretouch_leader_start(&leader, (uint64_t)epoch);
    foretouch_delaying_init(&delaying);
}

/* The robot moves; the draws are its sensors' noise. */
void EXPORT(page_exchange)(double encoder, double sensor, double accelerometer)
{
    foretouch_slide_exchange(&slide, desired, encoder, sensor, accelerometer, &sample.position, &sample.sensor_force,
        &sample.acceleration, &sample.exact_force, &sample.exact_position, &sample.commanded_position, &sample.clipped,
        &sample.effort);
}

/* A robot over this material, at rest, and a follower that knows nothing of it. */
void EXPORT(page_start_follower)(int material, double run)
{
    foretouch_follower_init(&follower);
    foretouch_follower_start(&follower, (uint64_t)run);
    materials[material](&slide);
    desired = 0.0;
    page_exchange(0.0, 0.0, 0.0);
}

void EXPORT(page_start_hand)(void)
{
    foretouch_hand_init(&hand);
    aim = force = force_before = 0.0;
    held = false;
}

/* ---- A tick ---- */

uint8_t *EXPORT(page_room)(void)
{
    return bytes;
}

double *EXPORT(page_shown)(void)
{
    return shown;
}

int EXPORT(page_hear)(int size)
{
    return (int)foretouch_leader_hear(&leader, bytes, (size_t)size);
}

int EXPORT(page_adopt)(int size)
{
    return (int)foretouch_leader_adopt(&leader, bytes, (size_t)size);
}

int EXPORT(page_take)(int size, double now)
{
    return (int)foretouch_follower_take(&follower, bytes, (size_t)size, (int64_t)now * MS, NULL);
}

void EXPORT(page_follow)(double now)
{
    desired = foretouch_follower_tick(&follower, &sample, (int64_t)now * MS, MS, false, false, false);
}

int EXPORT(page_telemetry)(double now)
{
    return (int)foretouch_follower_telemetry(&follower, &sample, (int64_t)now * MS, MS, 0, bytes, sizeof(bytes));
}

int EXPORT(page_model)(double now)
{
    return (int)foretouch_follower_model(&follower, (int64_t)now * MS, bytes, sizeof(bytes));
}

/* The hand moves to where it wants to be, as far as the force lets it, and is read as an encoder does. */
static double read_hand(double wanted)
{
    const double period = 1e-3, delay = @DELAY@, count = @RESOLUTION@;
    if (held) {
        const double speed = (wanted - aim) / period;
        foretouch_hand_move(&hand, aim, speed, force_before, delay);
        foretouch_hand_move(&hand, aim + speed * delay, speed, force, period - delay);
    } else {
        hand.position = wanted;
        held = true;
    }
    aim = wanted;
    return count * floor(hand.position / count + 0.5);
}

void EXPORT(page_lead)(double now, double wanted, int delayed)
{
    const double position = read_hand(wanted);
    const int64_t time = (int64_t)now * MS;
    const double given = delayed ? foretouch_leader_tick_delayed(&leader, &delaying, time, position, MS, false, false)
                                 : foretouch_leader_tick(&leader, time, position, MS, false, false);
    force_before = force;
    force = fmax(fmin(given, @LARGEST@), -@LARGEST@);
    shown[TIME] = now;
    shown[AIM] = wanted;
    shown[HAND] = hand.position;
    shown[PROXY] = leader.shown.position;
    shown[FELT] = given;
    shown[PREDICTED] = leader.shown.predicted_force;
    shown[ARRIVED] = leader.views[0].touching ? leader.views[0].force : 0.0;
    shown[LATE] = leader.views[0].position;
    shown[ROBOT] = sample.exact_position;
    shown[TRUE] = sample.exact_force;
}

int EXPORT(page_command)(void)
{
    return (int)foretouch_leader_command(&leader, HOLDER, bytes, sizeof(bytes));
}

/* ---- What is known ---- */

int EXPORT(page_has_model)(void)
{
    return leader.predictions[0].law.kind != 0;
}

int EXPORT(page_engaged)(void)
{
    return leader.shown.engaged;
}

int EXPORT(page_status)(void)
{
    return (int)follower.shown.status;
}

/* ---- A recording ---- */

void EXPORT(page_expect)(double delay)
{
    foretouch_follower_init(&fresh_follower);
    foretouch_leader_init(&fresh_leader);
    memset(&trial, 0, sizeof(trial));
    trial.conditionings[0] = fresh_follower.conditionings[0];
    trial.learnings[0] = fresh_follower.learnings[0];
    trial.banks[0] = fresh_follower.banks[0];
    trial.predictions[0] = fresh_leader.predictions[0];
    trial.stale = true;
    foretouch_trial_expect(&trial, delay);
}

void EXPORT(page_learn)(double time, double position, double force_there)
{
    foretouch_trial_learn(&trial, time, position, force_there);
}

double EXPORT(page_foretell)(double time, double position)
{
    return foretouch_trial_foretell(&trial, time, position);
}
