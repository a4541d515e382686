// A STUB of ROS 2 and ros2_control, for the controller beside it to be compiled where they are not: the names that it
// uses, as Humble and Jazzy have them, and nothing else. It is neither, and no part of them.

#ifndef RCLCPP_RCLCPP_HPP_STUB
#define RCLCPP_RCLCPP_HPP_STUB

#include <cstdint>
#include <map>
#include <memory>
#include <string>

namespace rclcpp {

class Time {
public:
    explicit Time(std::int64_t nanoseconds) : count(nanoseconds) {}
    std::int64_t nanoseconds() const { return count; }

private:
    std::int64_t count;
};

class Duration {
public:
    explicit Duration(std::int64_t nanoseconds) : count(nanoseconds) {}
    std::int64_t nanoseconds() const { return count; }

private:
    std::int64_t count;
};

} // namespace rclcpp

namespace rclcpp_lifecycle {

class State {};

} // namespace rclcpp_lifecycle

#endif
