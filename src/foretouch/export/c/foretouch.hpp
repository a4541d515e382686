// foretouch @VERSION@ in C++17: the functions of foretouch_session.h and of the safety in foretouch.h as members of
// values. Nothing here allocates or throws, and a value is copied like a number; a Leader and a Follower are large
// (sizeof), and belong into static memory or on the heap.
#ifndef FORETOUCH_HPP
#define FORETOUCH_HPP

#include <cstddef>
#include <cstdint>
#include <limits>

#include "foretouch_session.h"

namespace foretouch {

// What the safety layer is told in a tick, in SI units; the default of what is rarely given is that nothing is the
// matter.
struct SafetyInputs {
    double desired = std::numeric_limits<double>::quiet_NaN();  // commanded position, NaN for none [m]
    double silence = std::numeric_limits<double>::infinity();   // since the newest fresh command [s]
    double position = std::numeric_limits<double>::quiet_NaN(); // of the robot [m]
    double force = std::numeric_limits<double>::quiet_NaN();    // on it [N]
    bool in_contact = false;                                    // whether that is contact
    double surface = std::numeric_limits<double>::quiet_NaN();  // that was felt, NaN for none [m]
    double free = -std::numeric_limits<double>::infinity();     // up to where the air is free unseen [m]
    bool stopped = false;                                       // whether a stop is latched
    bool faulty = false;                                        // whether the sensors are wrong
    bool guarded = false;                                       // whether the command was held back for a first touch
    bool uncertain = false;                                     // whether the force is being judged
};

// What a tick of the safety layer gives along a line.
struct SafetyOutputs {
    double position;                  // for the robot, NaN before its position is known [m]
    double aim;                       // that the limits of its motion lead to [m]
    foretouch_follower_status status; // what it does, and why
};

// The last stage before the robot, along a line.
class Safety {
public:
    Safety() noexcept { foretouch_safety_init(&state); }

    // Take limits, before the first tick, for this period [s]; whether they are limits, each above 0.
    bool set(const foretouch_safety_limits &limits, double period) noexcept
    {
        foretouch_safety_init(&state);
        state.limits = limits;
        return foretouch_safety_set(&state, period);
    }

    SafetyOutputs tick(const SafetyInputs &in) noexcept
    {
        double aim = 0.0;
        std::int64_t status = 0;
        foretouch_safety_keep(&state, in.stopped, in.desired, in.position, in.force, in.in_contact, in.surface,
            in.silence, in.faulty, in.guarded, in.free, in.uncertain, &aim, &status);
        const double position = foretouch_safety_limit(&state);
        return {position, aim, static_cast<foretouch_follower_status>(status)};
    }

    foretouch_safety state;
};

// Bytes of somebody else's, such as a message that has come.
struct Bytes {
    const std::uint8_t *data = nullptr;
    std::size_t size = 0;

    bool empty() const noexcept { return size == 0; }
};

// A message that has been written, of at most so many bytes.
template <std::size_t Room> struct Written {
    std::uint8_t data[Room];
    std::size_t size = 0;

    bool empty() const noexcept { return size == 0; }
    operator Bytes() const noexcept { return {data, size}; } // valid as long as this is
};

using WrittenCommand = Written<FORETOUCH_COMMAND_ROOM>;
using WrittenTelemetry = Written<FORETOUCH_TELEMETRY_ROOM>;
using WrittenModel = Written<FORETOUCH_MODEL_UPDATE_ROOM>;

// Whether the hand feels the device that it holds, or moves one that gives no force, such as a mouse.
enum class Hand { feels, moves };

// The leader along a line: in each tick hear and adopt what has come, tick, and send the command.
class Leader {
public:
    // epoch: number of this process, above 0, and larger in one that is started later.
    explicit Leader(std::uint64_t epoch, Hand hand = Hand::feels) noexcept
    {
        hand == Hand::feels ? foretouch_leader_init(&state) : foretouch_leader_unfelt_init(&state);
        foretouch_leader_start(&state, epoch);
    }

    // Take a telemetry message, or a model message; what is none changes nothing.
    foretouch_status hear(Bytes telemetry) noexcept
    {
        return foretouch_leader_hear(&state, telemetry.data, telemetry.size);
    }
    foretouch_status adopt(Bytes model) noexcept { return foretouch_leader_adopt(&state, model.data, model.size); }

    // A tick at a time of a monotonic clock, this time after the last one really began [ns], with the hand at a
    // position, NaN where it is missing [m]; the force for the hand [N].
    double tick(std::int64_t now_ns, double hand, std::int64_t period_ns, bool clutched = false,
        bool stopping = false) noexcept
    {
        return foretouch_leader_tick(&state, now_ns, hand, period_ns, clutched, stopping);
    }

    // The command of the newest tick; empty where the name is no UTF-8 of at most 64 characters.
    WrittenCommand command(const char *holder) const noexcept
    {
        WrittenCommand written;
        written.size = foretouch_leader_command(&state, holder, written.data, sizeof written.data);
        return written;
    }

    // What the newest tick came to.
    const foretouch_shown &shown() const noexcept { return state.shown; }

    foretouch_leader state;
};

// What is asked of a follower beside the commands.
struct Asked {
    bool stop = false;    // an emergency stop
    bool release = false; // its end, at the robot
    bool ended = false;   // the session is over: leave the robot as after a long silence
};

// The follower along a line: in each tick take the commands that have come, tick, and send the model where one is due,
// and then the telemetry.
class Follower {
public:
    // run: number of this process, above 0, and larger in one that is started later.
    explicit Follower(std::uint64_t run) noexcept
    {
        foretouch_follower_init(&state);
        foretouch_follower_start(&state, run);
    }

    // Take a command that has come now; what is none changes nothing.
    foretouch_status take(Bytes command, std::int64_t now_ns) noexcept
    {
        return foretouch_follower_take(&state, command.data, command.size, now_ns, nullptr);
    }

    // Whether a Stop message ends the session: it is of the leader that is obeyed, or of no leader.
    bool ends(Bytes stop) const noexcept
    {
        foretouch_stop message;
        return foretouch_stop_decode(stop.data, stop.size, &message) == FORETOUCH_OK
            && (message.epoch == 0 || message.epoch == static_cast<std::uint64_t>(state.hearings[0].leases[0].epoch));
    }

    // A tick at a time of a monotonic clock, this time after the last one really began [ns]; the position for the
    // robot [m].
    double tick(const foretouch_sample &sample, std::int64_t now_ns, std::int64_t period_ns, Asked asked = {}) noexcept
    {
        return foretouch_follower_tick(&state, &sample, now_ns, period_ns, asked.stop, asked.release, asked.ended);
    }

    // The telemetry of the newest tick, after its model; compute_ns is how long the tick before took [ns].
    WrittenTelemetry telemetry(const foretouch_sample &sample, std::int64_t now_ns, std::int64_t period_ns,
        std::int64_t compute_ns) const noexcept
    {
        WrittenTelemetry written;
        written.size = foretouch_follower_telemetry(&state, &sample, now_ns, period_ns, compute_ns, written.data,
            sizeof written.data);
        return written;
    }

    // The model where one is due after a tick, and empty where not. It is written where it is to go, for it is large.
    bool model(std::int64_t now_ns, WrittenModel &written) noexcept
    {
        written.size = foretouch_follower_model(&state, now_ns, written.data, sizeof written.data);
        return !written.empty();
    }

    // What the newest tick came to.
    const foretouch_shown_follower &shown() const noexcept { return state.shown; }

    foretouch_follower state;
};

} // namespace foretouch

#endif
