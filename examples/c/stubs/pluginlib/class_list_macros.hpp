// A STUB of pluginlib: see rclcpp/rclcpp.hpp beside it.

#ifndef CLASS_LIST_MACROS_HPP_STUB
#define CLASS_LIST_MACROS_HPP_STUB

#include <type_traits>

#define PLUGINLIB_EXPORT_CLASS(kind, base) static_assert(std::is_base_of<base, kind>::value, "no such controller");

#endif
