// A follower on an arm of Franka, with libfranka: the tip goes down where the leader's hand goes in.
//
//     foretouch gate --side follower --listen tcp/127.0.0.1:7447 --at tcp/127.0.0.1:7461
//     ./franka_follower 172.16.0.2 127.0.0.1 7461
//
// NEVER RUN WITH libfranka, AND NEVER WITH AN ARM. It was compiled against examples/c/stubs/franka, which has the names
// that are used here and a robot of a few lines. Read it as a skeleton: before it moves an arm, check the sign of the
// force and of the motion by hand, and the limits below against those of your arm.

#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <memory>

#include <franka/exception.h>
#include <franka/robot.h>

#include "foretouch.hpp"
#include "gate_thread.hpp"
#include "ticks.h"

namespace {

constexpr std::size_t Z = 14; // place of the height in a pose of libfranka, which is written column by column
constexpr int UNLOADING = 2000; // ticks for which the arm may let go of what it presses at the end

// The follower, as it is called once a millisecond by libfranka's own loop.
class Callback {
public:
    explicit Callback(GateThread &through) : network(through), follower(ticks_process())
    {
        // The arm's own force has no tool in it. An arm of Franka takes less jerk than foretouch's default allows.
        follower.state.followers[0].tool_mass = 0.0;
        foretouch_safety &safety = follower.state.followers[0].safety[0];
        safety.limits.acceleration = 4.0;
        safety.limits.jerk = 2000.0;
        foretouch_safety_set(&safety, 1e-3);
    }

    franka::CartesianPose operator()(const franka::RobotState &state, franka::Duration period)
    {
        const std::int64_t woke = ticks_clock(CLOCK_MONOTONIC);
        const std::int64_t period_ns = static_cast<std::int64_t>(period.toMSec()) * TICK_NS;
        now = now == 0 ? woke : now + period_ns; // the arm's own even clock: how late this thread woke is in no velocity
        if (period.toMSec() == 0) { // the first call: from here on, what is commanded is relative to this pose
            begin = state.O_T_EE_c;
        }
        asked.stop = false; // once is enough: the follower keeps it
        network.take([&](foretouch_channel channel, foretouch::Bytes message) {
            if (channel == FORETOUCH_CHANNEL_COMMAND) {
                follower.take(message, now);
            } else if (channel == FORETOUCH_CHANNEL_STOP) {
                ended = ended || follower.ends(message);
            } else if (channel == FORETOUCH_CHANNEL_EMERGENCY) {
                asked.stop = true;
            }
        });
        asked.ended = ended || !network.connected();
        const foretouch_sample sample = shown(state);
        const double inwards = follower.tick(sample, now, period_ns, asked);
        if (follower.model(now, model)) {
            network.say(FORETOUCH_CHANNEL_MODEL, model);
        }
        network.say(FORETOUCH_CHANNEL_TELEMETRY, follower.telemetry(sample, now, period_ns, computed));
        std::array<double, 16> pose = begin;
        pose[Z] = begin[Z] - (std::isfinite(inwards) ? inwards : told);
        told = begin[Z] - pose[Z];
        computed = ticks_clock(CLOCK_MONOTONIC) - woke;
        left = asked.ended ? left + 1 : 0;
        const bool free = !follower.shown().in_contact && left > 1;
        return asked.ended && (free || left > UNLOADING) ? franka::MotionFinished(pose) : franka::CartesianPose(pose);
    }

    const foretouch_shown_follower &newest() const { return follower.shown(); }

private:
    // What the arm shows: in libfranka the external force is what the arm pushes with, so that a table under the tip
    // shows as negative z.
    foretouch_sample shown(const franka::RobotState &state) const
    {
        const double unknown = std::numeric_limits<double>::quiet_NaN();
        const double position = begin[Z] - state.O_T_EE[Z], commanded = begin[Z] - state.O_T_EE_c[Z];
        return {position, -state.O_F_ext_hat_K[2], 0.0, unknown, unknown, commanded, false, unknown};
    }

    GateThread &network;
    foretouch::Follower follower;
    foretouch::WrittenModel model;
    foretouch::Asked asked;
    std::array<double, 16> begin{};
    double told = 0.0;
    std::int64_t now = 0, computed = 0;
    int left = 0;
    bool ended = false;
};

} // namespace

int main(int count, char **words)
{
    if (count < 4) {
        std::fprintf(stderr, "franka_follower ARM GATE PORT, such as 172.16.0.2 127.0.0.1 7461\n");
        return 2;
    }
    GateThread network(words[2], static_cast<std::uint16_t>(std::atoi(words[3])));
    if (!network.connected()) {
        std::fprintf(stderr, "franka_follower: no gate at %s:%s\n", words[2], words[3]);
        return 1;
    }
    const auto callback = std::make_unique<Callback>(network); // too large for a stack
    try {
        franka::Robot robot(words[1]);
        robot.setCollisionBehavior({{20.0, 20.0, 18.0, 18.0, 16.0, 14.0, 12.0}}, {{20.0, 20.0, 18.0, 18.0, 16.0, 14.0, 12.0}},
            {{20.0, 20.0, 20.0, 25.0, 25.0, 25.0}}, {{20.0, 20.0, 20.0, 25.0, 25.0, 25.0}});
        robot.control([&](const franka::RobotState &state, franka::Duration period) { return (*callback)(state, period); });
    } catch (const franka::Exception &error) { // a reflex among them: it is not recovered from here
        std::fprintf(stderr, "franka_follower: %s\n", error.what());
        return 1;
    }
    std::printf("franka_follower: ended at %.1f mm, %.2f N\n", 1e3 * callback->newest().position, callback->newest().force);
    return 0;
}
