/* foretouch @VERSION@ for @TARGET@: a leader and a follower along a line, with their messages as bytes.

   A leader's tick: `foretouch_leader_hear` and `foretouch_leader_adopt` for what has come, `foretouch_leader_tick`,
   and `foretouch_leader_command`, whose bytes go to the follower. A follower's: `foretouch_follower_take` for each
   command that has come, `foretouch_follower_tick`, and behind it, in this order, `foretouch_follower_model` and
   `foretouch_follower_telemetry`, whose bytes go to the leader. How they get there is up to you; none has to arrive, in
   order or at all. Times are of a clock that is not below 0, or no message is written.

   Nothing here allocates, waits, or keeps anything outside of the structs. Both are large (`sizeof`): hold them in
   static memory or on the heap, not on a stack. Bytes may be anything: what is no message changes nothing. */

#ifndef FORETOUCH_SESSION_H
#define FORETOUCH_SESSION_H

#include "foretouch.h"
#include "foretouch_wire.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Give a leader or a follower, after its init function, the number of this process, above 0. It has to be another one
   in each process, and larger in a later one: milliseconds of the wall clock times 2^21, with random bits below. */
void foretouch_leader_start(foretouch_leader *leader, uint64_t epoch);
void foretouch_follower_start(foretouch_follower *follower, uint64_t run);

/* Take a telemetry message, or a model message, of the follower. */
foretouch_status foretouch_leader_hear(foretouch_leader *leader, const uint8_t *bytes, size_t size);
foretouch_status foretouch_leader_adopt(foretouch_leader *leader, const uint8_t *bytes, size_t size);

/* Write the command of the newest tick, and return its size; FORETOUCH_COMMAND_ROOM bytes are enough. 0 where the room
   is too small, or where the name is no UTF-8 of at most 64 characters.

   holder: Name of this leader, not empty. */
size_t foretouch_leader_command(const foretouch_leader *leader, const char *holder, uint8_t *bytes, size_t room);

/* What the robot's sensors show in a tick. Positions grow into the material [m]. */
typedef struct {
    double position;           /* of the tip, by the encoders [m] */
    double sensor_force;       /* as the sensor gives it, positive in compression [N] */
    double acceleration;       /* of the tool, positive into the material; 0 without an accelerometer [m/s^2] */
    double exact_force;        /* of a simulator; NaN on a robot [N] */
    double exact_position;     /* of a simulator; NaN on a robot [m] */
    double commanded_position; /* that the robot was told in the end [m] */
    bool clipped;              /* whether a limit of the robot's own cut that */
    double effort;             /* with which the drive pushes inwards, by its current; NaN where it does not say [N] */
} foretouch_sample;

/* Take a command of a leader that has come now, by this side's clock [ns]: `take_result`, where it is given, is 0 where
   it is obeyed, and else says why it is not, as foretouch_follower_take_received does. */
foretouch_status foretouch_follower_take(foretouch_follower *follower, const uint8_t *bytes, size_t size,
    int64_t now_ns, int64_t *take_result);

/* A tick; see foretouch_follower_step. Returns the position for the robot [m]. */
double foretouch_follower_tick(foretouch_follower *follower, const foretouch_sample *sample, int64_t now_ns,
    int64_t period_ns, bool stop, bool release, bool ended);

/* Write the telemetry of the newest tick, and return its size; FORETOUCH_TELEMETRY_ROOM bytes are enough.

   compute_ns: Computing time of the tick before [ns]. */
size_t foretouch_follower_telemetry(const foretouch_follower *follower, const foretouch_sample *sample, int64_t now_ns,
    int64_t period_ns, int64_t compute_ns, uint8_t *bytes, size_t room);

/* Write the model, where one is due after a tick, and return its size; 0 where none is. FORETOUCH_MODEL_UPDATE_ROOM
   bytes are needed. It carries no standard errors of its parameters, and gives as a reason only what is wrong with the
   sensors: both are for people, not for the leader. */
size_t foretouch_follower_model(foretouch_follower *follower, int64_t now_ns, uint8_t *bytes, size_t room);

#ifdef __cplusplus
}
#endif

#endif
