// foretouch @VERSION@ in C++17: the functions of foretouch.h as members of values. Nothing here allocates or throws, and
// a value is copied like a number.
#ifndef FORETOUCH_HPP
#define FORETOUCH_HPP

#include <cstdint>
#include <limits>

#include "foretouch.h"

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

} // namespace foretouch

#endif
