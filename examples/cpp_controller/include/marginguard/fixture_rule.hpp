// Rule of a controller: which twist the last marginguard_msgs/FixtureConstraint allows now.
//
// C++17 standard library only; no dynamic memory after construction, no exceptions, bounded run
// time. SI units as in the message: metres, m/s, rad/s; times in ns on the clock of the message's stamp.
// The decisions are those of FixtureRule in Python (app/fixture/control/controller_rule.py).
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <utility>

#include "marginguard/nearest_twist.hpp"
#include "marginguard/own_motion.hpp"

namespace marginguard {

constexpr std::size_t kMaxIdBytes = 128;
constexpr double kNormalTolerance = 1e-6;
constexpr double kMaxMagnitude = 1000.0;  // m, m/s: larger values are errors
constexpr int kStateUnknown = 3;  // FixtureConstraint.UNKNOWN, the last of the states

enum class Permission { kNoMotion, kRetreat, kWithinPlanes };

enum class Reason {
  kAllowed,
  kHold,              // the guard is on hold
  kInstanceChanged,   // another run of the guard sends, or two guards do; latched until rearm()
  kSetupChanged,      // tumour, its pose or the robot's registration changed; latched until rearm()
  kSeqNotIncreasing,  // a message was repeated or overtaken; latched until rearm()
  kNoMessage,
  kSilent,     // the last message arrived too long ago
  kExpired,    // valid_until has passed, or the planes are older than the remembered commands
  kClock,      // time runs backwards, or the message is from the future or valid for too long
  kMalformed,  // too many planes, no unit normals, values beyond 1 km, another frame, bad id, limits
               // below 0, or a known state without planes
  kNoPlanes,   // the state is UNKNOWN and the guard has no planes: it has had no usable pose yet
  kNotFinite,  // a plane, the desired twist or the tip contains NaN or infinity
  kSimulated,  // the poses are recorded or simulated, and the rule does not accept them
  kOtherPose,  // the planes belong to an earlier pose of the tool
};

inline const char* name_of(Permission permission) {
  switch (permission) {
    case Permission::kRetreat: return "retreat";
    case Permission::kWithinPlanes: return "within_planes";
    case Permission::kNoMotion: break;
  }
  return "no_motion";
}

inline const char* name_of(Reason reason) {
  switch (reason) {
    case Reason::kAllowed: return "allowed";
    case Reason::kHold: return "hold";
    case Reason::kInstanceChanged: return "instance_changed";
    case Reason::kSetupChanged: return "setup_changed";
    case Reason::kSeqNotIncreasing: return "seq_not_increasing";
    case Reason::kSilent: return "silent";
    case Reason::kExpired: return "expired";
    case Reason::kClock: return "clock";
    case Reason::kMalformed: return "malformed";
    case Reason::kNoPlanes: return "no_planes";
    case Reason::kNotFinite: return "not_finite";
    case Reason::kSimulated: return "simulated";
    case Reason::kOtherPose: return "other_pose";
    case Reason::kNoMessage: break;
  }
  return "no_message";
}

// Values of a FixtureConstraint message; not checked, FixtureRule does that.
struct PlainConstraint {
  std::string_view instance_id;
  std::uint64_t seq = 0;
  std::string_view frame;
  std::int64_t stamp_ns = 0;
  std::int64_t valid_until_ns = 0;
  int state = kStateUnknown;
  bool hold = true;
  bool simulated = true;
  bool planes_current = false;
  std::size_t count = 0;                       // length of half_spaces in the message
  std::array<HalfSpace, kMaxPlanes> planes{};  // the first kMaxPlanes of them
  double free_distance = 0.0;
  double free_turn = 0.0;
  double max_tool_speed = 0.0;
  double max_tool_turn = 0.0;
  std::string_view setup_id;
};

struct Decision {
  Vector6 twist{};  // velocity of the tip in m/s, then angular velocity in rad/s
  Permission permission = Permission::kNoMotion;
  Reason reason = Reason::kNoMessage;
};

struct RuleParameters {
  LimiterParameters limiter{};
  std::int64_t max_silence_ns = 100 * kNsPerMs;
  std::int64_t future_tolerance_ns = 5 * kNsPerMs;
  bool accept_simulated = false;  // true only where no patient and no robot is
  bool follows_setup = false;  // true only if tumour and base are taken from the messages' poses
};

// Use in one thread: receive() at each message, allow() at each control step.
//
// The planes are those of the message's stamp: what the tool has been commanded since, and tau / 2
// before, is subtracted from their clearances and from the free motion. So every allowed motion has
// to be executed, or less, within that time. A plane is approached at most at the message's
// max_tool_speed, or so that it cannot be reached before the message expires.
class FixtureRule {
 public:
  explicit FixtureRule(std::string frame = "tumor", RuleParameters parameters = {})
      : frame_(std::move(frame)),
        parameters_(parameters),
        lag_ns_(half_ns(parameters.limiter.tau_s)) {}

  // Accepts the guard that sends now. Call it only on a request of the controller's operator.
  // No motion is allowed until the next message.
  void rearm() {
    latched_ = false;
    has_ids_ = has_message_ = clock_jumped_ = false;
  }

  bool latched() const { return latched_; }

  // The tool is commanded to stand from `now_ns` on. Call it at a step without allow().
  void stand(std::int64_t now_ns) {
    check_clock(now_ns);
    own_.command({}, now_ns);
  }

  // Uses `message`, which has just arrived, for the following control steps.
  void receive(const PlainConstraint& message, std::int64_t now_ns) {
    check_clock(now_ns);
    if (!is_valid(message.instance_id) || !is_valid(message.setup_id)) {
      use(message, now_ns, Reason::kMalformed);
      return;
    }
    if (has_ids_ && !instance_id_.is(message.instance_id)) {
      latch(Reason::kInstanceChanged);
    } else if (has_ids_ && message.seq <= seq_) {
      if (!latched_) latch(Reason::kSeqNotIncreasing);
      return;
    }
    const bool is_other = has_ids_ && !setup_id_.is(message.setup_id);
    if (is_other && !parameters_.follows_setup && !stops()) latch(Reason::kSetupChanged);
    if (is_other) {
      own_.forget(now_ns);
      forgotten_ = Reason::kSetupChanged;
    }
    instance_id_.set(message.instance_id);
    setup_id_.set(message.setup_id);
    has_ids_ = true;
    seq_ = message.seq;
    use(message, now_ns, defect_of(message));
  }

  // The decision for the desired twist of the tool's tip, along the axes of the rule's frame.
  Decision allow(const Vector6& desired, const Vector3& tip, std::int64_t now_ns) {
    const Decision decision = decide(desired, tip, now_ns);
    own_.command(decision.twist, now_ns);
    return decision;
  }

 private:
  struct Id {
    std::array<char, kMaxIdBytes> bytes{};
    std::size_t size = 0;

    bool is(std::string_view other) const { return std::string_view{bytes.data(), size} == other; }

    void set(std::string_view valid) {
      size = valid.size();
      std::memcpy(bytes.data(), valid.data(), size);
    }
  };

  static bool is_valid(std::string_view id) { return !id.empty() && id.size() <= kMaxIdBytes; }

  static std::int64_t half_ns(double seconds) {
    const double half = std::nearbyint(seconds * static_cast<double>(kNsPerS) / 2.0);
    return half < static_cast<double>(kMaxTimeNs) ? static_cast<std::int64_t>(half) : kMaxTimeNs;
  }

  Decision decide(const Vector6& desired, const Vector3& tip, std::int64_t now_ns) {
    Decision decision;
    decision.reason = problem(now_ns);
    if (decision.reason == Reason::kAllowed && !(all_finite(desired) && all_finite(tip))) {
      decision.reason = Reason::kNotFinite;
    }
    if (decision.reason == Reason::kAllowed && !is_near(tip)) decision.reason = Reason::kMalformed;
    if (decision.reason != Reason::kAllowed) return decision;
    const bool hold = hold_ || latched_;
    if (hold) decision.reason = latched_ ? latch_reason_ : Reason::kHold;
    decision.permission = hold ? Permission::kRetreat : Permission::kWithinPlanes;
    std::array<HalfSpace, kMaxPlanes> planes = planes_;
    if (latched_) {  // the velocity of the tumour is no longer known
      for (HalfSpace& plane : planes) plane.tumor_velocity = {};
    }
    Vector3 origin = tip;  // at the time of the planes
    const Vector3 shift = own_.shift(stamp_ns_);
    for (std::size_t k = 0; k < 3; ++k) origin[k] -= shift[k];
    Delay delay;
    delay.moved = own_.since(stamp_ns_, lag_ns_, now_ns, planes, count_, origin);
    delay.free = free_;
    delay.max_approach_m_s = max_tool_speed_;
    delay.validity_s =
        static_cast<double>(valid_until_ns_ - stamp_ns_) / static_cast<double>(kNsPerS);
    LimiterParameters limits = parameters_.limiter;
    limits.max_rad_s = std::min(limits.max_rad_s, max_tool_turn_);
    decision.twist = limit_twist(desired, planes, count_, hold, origin, limits, &delay);
    return decision;
  }

  static bool is_near(const Vector3& values) {
    return std::all_of(values.begin(), values.end(),
                       [](double value) { return std::abs(value) <= kMaxMagnitude; });
  }

  void latch(Reason reason) {
    latched_ = true;
    latch_reason_ = reason;
  }

  // True if something is latched that allows no retreat either: the planes may be those of another
  // guard, or of another tumour than the one that the controller has a pose of.
  bool stops() const {
    return latched_ &&
           (latch_reason_ == Reason::kInstanceChanged || latch_reason_ == Reason::kSetupChanged);
  }

  // Drops the message if time has run backwards: its age is no longer known.
  void check_clock(std::int64_t now_ns) {
    if (has_now_ && now_ns < last_now_ns_) {
      has_message_ = false;
      clock_jumped_ = true;
      forgotten_ = Reason::kClock;
    }
    has_now_ = true;
    last_now_ns_ = now_ns;
    own_.hold_until(now_ns);
  }

  void use(const PlainConstraint& message, std::int64_t now_ns, Reason defect) {
    has_message_ = true;
    clock_jumped_ = false;
    received_ns_ = now_ns;
    stamp_ns_ = message.stamp_ns;
    valid_until_ns_ = message.valid_until_ns;
    hold_ = message.hold || message.state == kStateUnknown;
    simulated_ = message.simulated;
    planes_current_ = message.planes_current;
    count_ = defect == Reason::kAllowed ? message.count : 0;
    planes_ = message.planes;
    free_ = {message.free_distance, message.free_turn};
    max_tool_speed_ = message.max_tool_speed;
    max_tool_turn_ = message.max_tool_turn;
    defect_ = defect;
  }

  Reason defect_of(const PlainConstraint& message) const {
    if (message.frame != frame_ || message.state < 0 || message.state > kStateUnknown ||
        message.count > kMaxPlanes) {
      return Reason::kMalformed;
    }
    if (message.count == 0) {
      return message.state == kStateUnknown ? Reason::kNoPlanes : Reason::kMalformed;
    }
    for (std::size_t k = 0; k < message.count; ++k) {
      const HalfSpace& plane = message.planes[k];
      if (!(all_finite(plane.normal) && std::isfinite(plane.offset) &&
            all_finite(plane.point_on_tool) && all_finite(plane.tumor_velocity))) {
        return Reason::kNotFinite;
      }
    }
    const std::array<double, 4> numbers{message.free_distance, message.free_turn,
                                        message.max_tool_speed, message.max_tool_turn};
    if (!all_finite(numbers)) return Reason::kNotFinite;
    if (*std::min_element(numbers.begin(), numbers.end()) < 0.0 || !(message.max_tool_turn > 0.0)) {
      return Reason::kMalformed;
    }
    for (std::size_t k = 0; k < message.count; ++k) {
      const HalfSpace& plane = message.planes[k];
      const Vector3& n = plane.normal;
      if (std::abs(std::hypot(n[0], n[1], n[2]) - 1.0) > kNormalTolerance ||
          std::abs(plane.offset) > kMaxMagnitude || !is_near(plane.point_on_tool) ||
          !is_near(plane.tumor_velocity)) {
        return Reason::kMalformed;
      }
    }
    return Reason::kAllowed;
  }

  // Why no motion is allowed at `now_ns`; kAllowed if planes are known and valid.
  Reason problem(std::int64_t now_ns) {
    check_clock(now_ns);
    if (stops()) return latch_reason_;
    if (!has_message_) return clock_jumped_ ? Reason::kClock : Reason::kNoMessage;
    if (defect_ != Reason::kAllowed) return defect_;
    if (simulated_ && !parameters_.accept_simulated) return Reason::kSimulated;
    if (now_ns >= valid_until_ns_) return Reason::kExpired;
    // valid_until_ns_ is later than now_ns; if one of these is absurd, a difference could overflow.
    for (const std::int64_t time : {now_ns, stamp_ns_, valid_until_ns_}) {
      if (time > kMaxTimeNs || time < -kMaxTimeNs) return Reason::kClock;
    }
    const std::int64_t validity_ns = valid_until_ns_ - stamp_ns_;
    if (stamp_ns_ > now_ns + parameters_.future_tolerance_ns || validity_ns <= 0 ||
        validity_ns > kMaxValidityNs) {
      return Reason::kClock;
    }
    if (now_ns - received_ns_ > parameters_.max_silence_ns) return Reason::kSilent;
    if (!planes_current_) return Reason::kOtherPose;
    const std::int64_t since_ns = stamp_ns_ - lag_ns_;
    if (own_.knows(since_ns)) return Reason::kAllowed;
    return since_ns < own_.known_from_ns() ? forgotten_ : Reason::kExpired;
  }

  std::string frame_;
  RuleParameters parameters_;
  std::int64_t lag_ns_;
  OwnMotion own_;
  Reason forgotten_ = Reason::kClock;  // why nothing is known before own_.known_from_ns()
  bool has_ids_ = false;
  Id instance_id_;
  Id setup_id_;
  std::uint64_t seq_ = 0;
  bool latched_ = false;
  Reason latch_reason_ = Reason::kAllowed;
  bool has_now_ = false;
  std::int64_t last_now_ns_ = 0;
  bool clock_jumped_ = false;
  bool has_message_ = false;
  std::int64_t received_ns_ = 0;
  std::int64_t stamp_ns_ = 0;
  std::int64_t valid_until_ns_ = 0;
  bool hold_ = true;
  bool simulated_ = true;
  bool planes_current_ = false;
  Reason defect_ = Reason::kNoMessage;
  std::size_t count_ = 0;
  std::array<HalfSpace, kMaxPlanes> planes_{};
  FreeMotion free_{};
  double max_tool_speed_ = 0.0;
  double max_tool_turn_ = 0.0;
};

}  // namespace marginguard
