// A STUB of ros2_control: see rclcpp/rclcpp.hpp beside it.

#ifndef CONTROLLER_INTERFACE_HPP_STUB
#define CONTROLLER_INTERFACE_HPP_STUB

#include <string>
#include <utility>
#include <vector>

#include "rclcpp/rclcpp.hpp"

namespace hardware_interface {

// One number of the hardware; the stub's points to where a test has it.
class LoanedCommandInterface {
public:
    explicit LoanedCommandInterface(double *at) : place(at) {}
    void set_value(double value) { *place = value; }
    double get_value() const { return *place; }

private:
    double *place;
};

using LoanedStateInterface = LoanedCommandInterface;

} // namespace hardware_interface

namespace controller_interface {

enum class return_type : std::uint8_t { OK = 0, ERROR = 1 };
enum class CallbackReturn { SUCCESS, FAILURE, ERROR };
enum class interface_configuration_type : std::uint8_t { ALL = 0, INDIVIDUAL = 1, NONE = 2 };

struct InterfaceConfiguration {
    interface_configuration_type type;
    std::vector<std::string> names = {};
};

class ControllerInterface {
public:
    virtual ~ControllerInterface() = default;
    virtual InterfaceConfiguration command_interface_configuration() const = 0;
    virtual InterfaceConfiguration state_interface_configuration() const = 0;
    virtual CallbackReturn on_init() = 0;
    virtual CallbackReturn on_configure(const rclcpp_lifecycle::State &) { return CallbackReturn::SUCCESS; }
    virtual CallbackReturn on_activate(const rclcpp_lifecycle::State &) { return CallbackReturn::SUCCESS; }
    virtual CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) { return CallbackReturn::SUCCESS; }
    virtual return_type update(const rclcpp::Time &time, const rclcpp::Duration &period) = 0;

    // Of the stub: what the controller manager does with interfaces and parameters.
    void lend(std::vector<hardware_interface::LoanedCommandInterface> commands,
        std::vector<hardware_interface::LoanedStateInterface> states)
    {
        command_interfaces_ = std::move(commands);
        state_interfaces_ = std::move(states);
    }
    std::map<std::string, std::string> given;

protected:
    template <typename Parameter> Parameter auto_declare(const std::string &name, const Parameter &otherwise);

    std::vector<hardware_interface::LoanedCommandInterface> command_interfaces_;
    std::vector<hardware_interface::LoanedStateInterface> state_interfaces_;
};

template <> inline std::string ControllerInterface::auto_declare(const std::string &name, const std::string &otherwise)
{
    return given.count(name) ? given.at(name) : otherwise;
}

template <> inline int ControllerInterface::auto_declare(const std::string &name, const int &otherwise)
{
    return given.count(name) ? std::stoi(given.at(name)) : otherwise;
}

} // namespace controller_interface

#endif
