// A follower as a controller of ros2_control: a joint along a line goes where the leader's hand goes.
//
//     foretouch gate --side follower --listen tcp/127.0.0.1:7447 --at tcp/127.0.0.1:7461
//
//     controller_manager:
//       ros__parameters:
//         update_rate: 1000
//         follower: {type: foretouch_example/FollowerController}
//     follower:
//       ros__parameters: {joint: press, sensor: wrist, gate: 127.0.0.1, port: 7461}
//
// NEVER RUN WITH ROS 2. It was compiled against examples/c/stubs, which has the names that are used here, as Humble and
// Jazzy have them. Read it as a skeleton: `press/position` grows into the material, and `wrist/force.z` is positive in
// compression, or the sign below has to be turned.

#include <cmath>
#include <limits>
#include <memory>
#include <string>

#include "controller_interface/controller_interface.hpp"
#include "pluginlib/class_list_macros.hpp"
#include "rclcpp/rclcpp.hpp"

#include "foretouch.hpp"
#include "gate_thread.hpp"
#include "ticks.h"

namespace foretouch_example {

using controller_interface::CallbackReturn;

class FollowerController : public controller_interface::ControllerInterface {
public:
    CallbackReturn on_init() override
    {
        joint = auto_declare<std::string>("joint", "press");
        sensor = auto_declare<std::string>("sensor", "wrist");
        address = auto_declare<std::string>("gate", "127.0.0.1");
        port = auto_declare<int>("port", 7461);
        return CallbackReturn::SUCCESS;
    }

    controller_interface::InterfaceConfiguration command_interface_configuration() const override
    {
        return {controller_interface::interface_configuration_type::INDIVIDUAL, {joint + "/position"}};
    }

    controller_interface::InterfaceConfiguration state_interface_configuration() const override
    {
        return {controller_interface::interface_configuration_type::INDIVIDUAL, {joint + "/position", sensor + "/force.z"}};
    }

    // Everything that takes time or memory is done here, before the first update.
    CallbackReturn on_activate(const rclcpp_lifecycle::State &) override
    {
        network = std::make_unique<GateThread>(address, static_cast<std::uint16_t>(port));
        if (!network->connected()) {
            return CallbackReturn::FAILURE;
        }
        follower = std::make_unique<foretouch::Follower>(ticks_process());
        follower->state.followers[0].tool_mass = 0.0; // the sensor's driver weighs the tool out
        told = state_interfaces_[0].get_value();
        asked = {};
        now = ticks_clock(CLOCK_MONOTONIC);
        return CallbackReturn::SUCCESS;
    }

    CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) override
    {
        network.reset();
        return CallbackReturn::SUCCESS;
    }

    controller_interface::return_type update(const rclcpp::Time &, const rclcpp::Duration &period) override
    {
        const std::int64_t woke = ticks_clock(CLOCK_MONOTONIC);
        now += period.nanoseconds(); // as the controller manager counts it
        asked.stop = false; // once is enough: the follower keeps it
        network->take([&](foretouch_channel channel, foretouch::Bytes message) {
            if (channel == FORETOUCH_CHANNEL_COMMAND) {
                follower->take(message, now);
            } else if (channel == FORETOUCH_CHANNEL_STOP) {
                asked.ended = asked.ended || follower->ends(message);
            } else if (channel == FORETOUCH_CHANNEL_EMERGENCY) {
                asked.stop = true;
            }
        });
        asked.ended = asked.ended || !network->connected();
        const double unknown = std::numeric_limits<double>::quiet_NaN();
        const foretouch_sample sample = {state_interfaces_[0].get_value(), state_interfaces_[1].get_value(), 0.0, unknown,
            unknown, told, false, unknown};
        const double position = follower->tick(sample, now, period.nanoseconds(), asked);
        if (std::isfinite(position)) {
            told = position;
        }
        (void)command_interfaces_[0].set_value(told); // of later versions it returns whether there was room
        if (follower->model(now, model)) {
            network->say(FORETOUCH_CHANNEL_MODEL, model);
        }
        network->say(FORETOUCH_CHANNEL_TELEMETRY, follower->telemetry(sample, now, period.nanoseconds(), computed));
        computed = ticks_clock(CLOCK_MONOTONIC) - woke;
        return controller_interface::return_type::OK;
    }

private:
    std::string joint, sensor, address;
    int port = 0;
    std::unique_ptr<GateThread> network;
    std::unique_ptr<foretouch::Follower> follower;
    foretouch::WrittenModel model;
    foretouch::Asked asked;
    double told = 0.0;
    std::int64_t now = 0, computed = 0;
};

} // namespace foretouch_example

PLUGINLIB_EXPORT_CLASS(foretouch_example::FollowerController, controller_interface::ControllerInterface)
