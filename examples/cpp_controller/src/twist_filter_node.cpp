// ROS 2 node: passes on the part of a desired twist that the virtual fixture allows now.
//
// Subscribes /marginguard/constraint, desired_twist and tip (geometry_msgs/PointStamped), publishes
// safe_twist at 200 Hz, and serves controller_rearm for the operator of this controller. All
// vectors are along the axes of the constraint's frame, in m and m/s. The node's clock must be that
// of the stamps: `source.clock: host` in live.yaml, with PTP between two machines.
//
// The watchdog is the timer: at each period the rule decides anew, and a guard that is silent, lost
// or replaced allows nothing (FixtureRule), nor does another tumour or registration. Each change of
// the reason is logged.
#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "geometry_msgs/msg/point_stamped.hpp"
#include "geometry_msgs/msg/twist_stamped.hpp"
#include "marginguard/fixture_rule.hpp"
#include "marginguard_msgs/msg/fixture_constraint.hpp"
#include "rclcpp/rclcpp.hpp"
#include "std_srvs/srv/trigger.hpp"

namespace {

using geometry_msgs::msg::PointStamped;
using geometry_msgs::msg::TwistStamped;
using marginguard_msgs::msg::FixtureConstraint;
using std_srvs::srv::Trigger;

constexpr std::chrono::milliseconds kPeriod{5};
constexpr std::int64_t kMaxCommandAgeNs = 100 * marginguard::kNsPerMs;

template <typename V>
marginguard::Vector3 vector_of(const V& value) {
  return {value.x, value.y, value.z};
}

std::int64_t ns_of(const builtin_interfaces::msg::Time& time) {
  return static_cast<std::int64_t>(time.sec) * marginguard::kNsPerS + time.nanosec;
}

template <typename Value>
struct Timed {
  std::int64_t received_ns = 0;
  Value value{};
};

class TwistFilter : public rclcpp::Node {
 public:
  TwistFilter()
      : Node("twist_filter"),
        frame_(declare_parameter<std::string>("frame", "tumor")),
        rule_(frame_, parameters()) {
    const auto newest = rclcpp::QoS(1);
    constraints_ = create_subscription<FixtureConstraint>(
        "/marginguard/constraint", newest,
        [this](const FixtureConstraint& message) { receive(message); });
    commands_ = create_subscription<TwistStamped>(
        "desired_twist", newest, [this](const TwistStamped& message) {
          command_.reset();
          if (message.header.frame_id != frame_) return;
          const auto v = vector_of(message.twist.linear), w = vector_of(message.twist.angular);
          command_ = Timed<marginguard::Vector6>{now_ns(), {v[0], v[1], v[2], w[0], w[1], w[2]}};
        });
    tips_ = create_subscription<PointStamped>(
        "tip", newest, [this](const PointStamped& message) {
          tip_.reset();
          if (message.header.frame_id != frame_) return;
          tip_ = Timed<marginguard::Vector3>{now_ns(), vector_of(message.point)};
        });
    rearm_ = create_service<Trigger>(
        "controller_rearm",
        [this](const Trigger::Request::SharedPtr, Trigger::Response::SharedPtr reply) {
          rule_.rearm();
          reply->success = true;
        });
    safe_ = create_publisher<TwistStamped>("safe_twist", newest);
    watchdog_ = create_wall_timer(kPeriod, [this] { step(); });
  }

 private:
  marginguard::RuleParameters parameters() {
    marginguard::RuleParameters found;
    // True only where no patient and no robot is: allows motion by recorded or simulated poses.
    found.accept_simulated = declare_parameter<bool>("accept_simulated", false);
    return found;
  }

  // System time, as the stamps of the constraint. The node's own clock is not used: with use_sim_time
  // a paused /clock would stop it, and silence would have no age.
  std::int64_t now_ns() { return system_.now().nanoseconds(); }

  template <typename Value>
  bool is_recent(const std::optional<Timed<Value>>& input, std::int64_t now_ns) const {
    if (!input) return false;
    const std::int64_t age_ns = now_ns - input->received_ns;
    return age_ns >= 0 && age_ns <= kMaxCommandAgeNs;
  }

  void receive(const FixtureConstraint& message) {
    marginguard::PlainConstraint plain;
    plain.instance_id = message.instance_id;
    plain.seq = message.seq;
    plain.frame = message.header.frame_id;
    plain.stamp_ns = ns_of(message.header.stamp);
    plain.valid_until_ns = ns_of(message.valid_until);
    plain.state = message.state;
    plain.hold = message.hold;
    plain.simulated = message.simulated;
    plain.planes_current = message.planes_current;
    plain.count = message.half_spaces.size();
    for (std::size_t k = 0; k < std::min(plain.count, marginguard::kMaxPlanes); ++k) {
      const auto& plane = message.half_spaces[k];
      plain.planes[k] = {vector_of(plane.normal), plane.offset, vector_of(plane.point_on_tool),
                         vector_of(plane.tumor_velocity)};
    }
    plain.free_distance = message.free_distance;
    plain.free_turn = message.free_turn;
    plain.max_tool_speed = message.max_tool_speed;
    plain.max_tool_turn = message.max_tool_turn;
    plain.setup_id = message.setup_id;
    rule_.receive(plain, now_ns());
  }

  void step() {
    const std::int64_t now = now_ns();
    marginguard::Decision decision;  // no motion
    std::string reason = "no_command";
    if (is_recent(command_, now) && is_recent(tip_, now)) {
      decision = rule_.allow(command_->value, tip_->value, now);
      reason = name_of(decision.reason);
    } else {
      rule_.stand(now);
    }
    if (reason != logged_) {
      logged_ = reason;
      RCLCPP_INFO(get_logger(), "%s: %s", name_of(decision.permission), reason.c_str());
    }
    TwistStamped safe;
    safe.header.frame_id = frame_;
    safe.header.stamp = rclcpp::Time(now, RCL_SYSTEM_TIME);
    safe.twist.linear.x = decision.twist[0];
    safe.twist.linear.y = decision.twist[1];
    safe.twist.linear.z = decision.twist[2];
    safe.twist.angular.x = decision.twist[3];
    safe.twist.angular.y = decision.twist[4];
    safe.twist.angular.z = decision.twist[5];
    safe_->publish(safe);
  }

  rclcpp::Clock system_{RCL_SYSTEM_TIME};
  std::string frame_;
  marginguard::FixtureRule rule_;
  std::string logged_;
  std::optional<Timed<marginguard::Vector6>> command_;
  std::optional<Timed<marginguard::Vector3>> tip_;
  rclcpp::Subscription<FixtureConstraint>::SharedPtr constraints_;
  rclcpp::Subscription<TwistStamped>::SharedPtr commands_;
  rclcpp::Subscription<PointStamped>::SharedPtr tips_;
  rclcpp::Service<Trigger>::SharedPtr rearm_;
  rclcpp::Publisher<TwistStamped>::SharedPtr safe_;
  rclcpp::TimerBase::SharedPtr watchdog_;
};

}  // namespace

int main(int argc, char** argv) {
  rclcpp::init(argc, argv);
  rclcpp::spin(std::make_shared<TwistFilter>());
  rclcpp::shutdown();
  return 0;
}
