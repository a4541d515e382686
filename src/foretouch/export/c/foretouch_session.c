/* foretouch @VERSION@: the messages of a leader and a follower between bytes and the kernels' records. */

#include "foretouch_session.h"

#include <string.h>

#include "foretouch_names.inc"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

void foretouch_leader_start(foretouch_leader *leader, uint64_t epoch)
{
    leader->views[0].epoch = (int64_t)epoch;
}

void foretouch_follower_start(foretouch_follower *follower, uint64_t run)
{
    follower->hearings[0].run = (int64_t)run;
}

foretouch_status foretouch_leader_hear(foretouch_leader *leader, const uint8_t *bytes, size_t size)
{
    foretouch_telemetry message;
    const foretouch_status status = foretouch_telemetry_decode(bytes, size, &message);
    if (status == FORETOUCH_OK) {
        foretouch_leader_heard(leader, (int64_t)message.run, (int64_t)message.sequence, (int64_t)message.epoch,
            (int64_t)message.status, message.position, message.desired_position, message.force, message.in_contact);
    }
    return status;
}

/* Place of a law among the names that the kernels know, negative where it is none of them. */
static int64_t law_of(foretouch_text name)
{
    for (size_t place = 0; place < COUNT(law_names); place++) {
        if (strlen(law_names[place]) == name.size && memcmp(law_names[place], name.text, name.size) == 0) {
            return (int64_t)place;
        }
    }
    return -1;
}

foretouch_status foretouch_leader_adopt(foretouch_leader *leader, const uint8_t *bytes, size_t size)
{
    foretouch_model_update message;
    foretouch_received_model *received = &leader->received;
    const foretouch_status status = foretouch_model_update_decode(bytes, size, &message);
    if (status != FORETOUCH_OK) {
        return status;
    }
    received->run = (int64_t)message.run;
    received->sequence = (int64_t)message.sequence;
    received->epoch = (int64_t)message.epoch;
    received->command_sequence = (int64_t)message.command_sequence;
    received->law = law_of(message.law);
    received->parameter_count = message.parameters.count;
    foretouch_numbers_read(&message.parameters, received->parameters, COUNT(received->parameters));
    received->state_count = message.state.count;
    foretouch_numbers_read(&message.state, received->state, COUNT(received->state));
    received->surface = message.surface;
    received->valid = message.valid;
    received->map_count = message.map.size % sizeof(float) ? -1 : (int64_t)(message.map.size / sizeof(float));
    if (message.map.size > 0 && message.map.size <= sizeof(received->map)) {
        memcpy(received->map, message.map.bytes, message.map.size);
    }
    foretouch_leader_adopt_received(leader);
    return status;
}

size_t foretouch_leader_command(const foretouch_leader *leader, const char *holder, uint8_t *bytes, size_t room)
{
    foretouch_command message;
    foretouch_command_init(&message);
    message.sequence = (uint64_t)leader->sequence;
    message.time_ns = (uint64_t)leader->newest_ns;
    message.position = leader->shown.position;
    message.acknowledged_model = (uint64_t)leader->predictions[0].message;
    message.guarded = leader->guarded;
    message.holder = foretouch_text_of(holder);
    message.epoch = (uint64_t)leader->views[0].epoch;
    message.telemetry_sequence = (uint64_t)leader->views[0].newest_telemetry;
    message.run = (uint64_t)leader->views[0].run;
    return foretouch_command_encode(&message, bytes, room);
}

foretouch_status foretouch_follower_take(foretouch_follower *follower, const uint8_t *bytes, size_t size,
    int64_t now_ns, int64_t *take_result)
{
    foretouch_command message;
    foretouch_received_command *received = &follower->received;
    const foretouch_status status = foretouch_command_decode(bytes, size, &message);
    if (status != FORETOUCH_OK) {
        return status;
    }
    memcpy(received->holder, message.holder.text, message.holder.size);
    received->holder_size = message.holder.size;
    received->epoch = (int64_t)message.epoch;
    received->sequence = (int64_t)message.sequence;
    received->time_ns = (int64_t)message.time_ns;
    received->telemetry_sequence = (int64_t)message.telemetry_sequence;
    received->run = (int64_t)message.run;
    received->position = message.position;
    received->acknowledged_model = (int64_t)message.acknowledged_model;
    received->guarded = message.guarded;
    const int64_t result = foretouch_follower_take_received(follower, now_ns);
    if (take_result != NULL) {
        *take_result = result;
    }
    return status;
}

double foretouch_follower_tick(foretouch_follower *follower, const foretouch_sample *sample, int64_t now_ns,
    int64_t period_ns, bool stop, bool release, bool ended)
{
    return foretouch_follower_step(follower, sample->position, sample->sensor_force, sample->acceleration,
        sample->exact_force, sample->exact_position, sample->commanded_position, sample->clipped, sample->effort,
        now_ns, period_ns, stop, release, ended);
}

size_t foretouch_follower_telemetry(const foretouch_follower *follower, const foretouch_sample *sample, int64_t now_ns,
    int64_t period_ns, int64_t compute_ns, uint8_t *bytes, size_t room)
{
    const foretouch_shown_follower *shown = &follower->shown;
    foretouch_telemetry message;
    foretouch_telemetry_init(&message);
    message.sequence = (uint64_t)shown->sequence;
    message.time_ns = (uint64_t)now_ns;
    message.command_sequence = (uint64_t)shown->command_sequence;
    message.desired_position = shown->desired_position;
    message.position = shown->position;
    message.velocity = shown->velocity;
    message.sensor_force = shown->sensor_force;
    message.force = shown->force;
    message.exact_force = sample->exact_force;
    message.in_contact = shown->in_contact;
    message.clipped = sample->clipped;
    message.model_sequence = (uint64_t)follower->hearings[0].sendings[0].sequence;
    message.period_ns = (uint64_t)period_ns;
    message.compute_ns = (uint64_t)compute_ns;
    message.guarded = shown->guarded;
    message.status = (uint64_t)shown->status;
    message.validity = (uint64_t)shown->validity;
    message.epoch = (uint64_t)follower->hearings[0].leases[0].epoch;
    message.run = (uint64_t)follower->hearings[0].run;
    return foretouch_telemetry_encode(&message, bytes, room);
}

size_t foretouch_follower_model(foretouch_follower *follower, int64_t now_ns, uint8_t *bytes, size_t room)
{
    if (room < FORETOUCH_MODEL_UPDATE_ROOM || !foretouch_follower_publish(follower, now_ns)) {
        return 0;
    }
    const foretouch_published *learnt = &follower->published[0];
    const int64_t sensors = follower->shown.validity;
    foretouch_model_update message;
    foretouch_model_update_init(&message);
    message.sequence = (uint64_t)learnt->sequence;
    message.time_ns = (uint64_t)now_ns;
    message.command_sequence = (uint64_t)learnt->command_sequence;
    message.epoch = (uint64_t)learnt->epoch;
    message.run = (uint64_t)follower->hearings[0].run;
    message.valid = learnt->valid;
    message.surface = learnt->surface;
    message.estimator = foretouch_text_of(ESTIMATOR);
    if (sensors > 0 && (size_t)sensors < COUNT(sensor_sentences)) {
        message.reason = foretouch_text_of(sensor_sentences[sensors]);
    }
    if (learnt->valid) {
        message.state.values = learnt->state;
        message.state.count = COUNT(learnt->state);
        message.law = foretouch_text_of(LEARNT_LAW);
        message.parameters.values = learnt->parameters;
        message.parameters.count = COUNT(learnt->parameters);
        message.map.bytes = (const uint8_t *)learnt->map;
        message.map.size = (uint32_t)learnt->count * (uint32_t)sizeof(float);
    }
    const size_t size = foretouch_model_update_encode(&message, bytes, room);
    foretouch_follower_published(follower, (int64_t)size);
    return size;
}
