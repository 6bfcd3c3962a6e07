// Rule of a controller: which twist the last received marginguard_msgs/FixtureConstraint allows now.
//
// C++17 standard library only; no dynamic memory after construction, no exceptions, bounded run time.
// SI units as in the message: metres, m/s, rad/s; times in ns on the clock of the message's stamp.
// The decisions are those of FixtureRule in Python (app/fixture/control/controller_rule.py).
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <string>
#include <string_view>
#include <utility>

#include "marginguard/nearest_twist.hpp"

namespace marginguard {

constexpr std::size_t kMaxIdBytes = 128;
constexpr std::int64_t kNsPerMs = 1'000'000;
constexpr std::int64_t kNsPerS = 1'000'000'000;
constexpr std::int64_t kMaxValidityNs = 10 * kNsPerS;  // the largest stale_after_ms of a guard
constexpr double kNormalTolerance = 1e-6;
constexpr double kMaxMagnitude = 1000.0;  // m, m/s: larger values are errors
constexpr int kStateUnknown = 3;  // FixtureConstraint.UNKNOWN, the last of the states

enum class Permission { kNoMotion, kRetreat, kWithinPlanes };

enum class Reason {
  kAllowed,
  kHold,              // the guard is on hold
  kInstanceChanged,   // another run of the guard sends, or two guards do; latched until rearm()
  kSeqNotIncreasing,  // a message was repeated or overtaken; latched until rearm()
  kNoMessage,
  kSilent,     // the last message arrived too long ago
  kExpired,    // valid_until has passed
  kClock,      // time runs backwards, or the message is from the future or valid for too long
  kMalformed,  // too many planes, no unit normals, values beyond 1 km, another frame, bad id, or a
               // known state without planes
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
};

// Use in one thread: receive() at each message, allow() at each control step.
class FixtureRule {
 public:
  explicit FixtureRule(std::string frame = "tumor", RuleParameters parameters = {})
      : frame_(std::move(frame)), parameters_(parameters) {}

  // Accepts the guard that sends now. Call it only on a request of the controller's operator.
  // No motion is allowed until the next message.
  void rearm() {
    latched_ = false;
    has_instance_ = has_message_ = clock_jumped_ = false;
  }

  bool latched() const { return latched_; }

  // Uses `message`, which has just arrived, for the following control steps.
  void receive(const PlainConstraint& message, std::int64_t now_ns) {
    check_clock(now_ns);
    if (message.instance_id.empty() || message.instance_id.size() > kMaxIdBytes) {
      use(message, now_ns, Reason::kMalformed);
      return;
    }
    if (has_instance_ && message.instance_id != instance_id()) {
      latch(Reason::kInstanceChanged);
    } else if (has_instance_ && message.seq <= seq_) {
      if (!latched_) latch(Reason::kSeqNotIncreasing);
      return;
    }
    id_bytes_ = message.instance_id.size();
    std::memcpy(id_.data(), message.instance_id.data(), id_bytes_);
    has_instance_ = true;
    seq_ = message.seq;
    use(message, now_ns, defect_of(message));
  }

  // The decision for the desired twist of the tool's tip, along the axes of the rule's frame.
  Decision allow(const Vector6& desired, const Vector3& tip, std::int64_t now_ns) {
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
    // The planes are those of the stamp: until the message expires, the tool must not travel further
    // than its clearance.
    LimiterParameters limits = parameters_.limiter;
    const double validity_s =
        static_cast<double>(valid_until_ns_ - stamp_ns_) / static_cast<double>(kNsPerS);
    limits.tau_s = std::max(limits.tau_s, validity_s);
    decision.twist = limit_twist(desired, planes, count_, hold, tip, limits);
    return decision;
  }

 private:
  std::string_view instance_id() const { return {id_.data(), id_bytes_}; }

  static bool is_near(const Vector3& values) {
    return std::all_of(values.begin(), values.end(),
                       [](double value) { return std::abs(value) <= kMaxMagnitude; });
  }

  void latch(Reason reason) {
    latched_ = true;
    latch_reason_ = reason;
  }

  // Drops the message if time has run backwards: its age is no longer known.
  void check_clock(std::int64_t now_ns) {
    if (has_now_ && now_ns < last_now_ns_) {
      has_message_ = false;
      clock_jumped_ = true;
    }
    has_now_ = true;
    last_now_ns_ = now_ns;
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
    // Of two guards, retreat from the planes of one may approach the other's.
    if (latched_ && latch_reason_ == Reason::kInstanceChanged) return Reason::kInstanceChanged;
    if (!has_message_) return clock_jumped_ ? Reason::kClock : Reason::kNoMessage;
    if (defect_ != Reason::kAllowed) return defect_;
    if (simulated_ && !parameters_.accept_simulated) return Reason::kSimulated;
    if (now_ns >= valid_until_ns_) return Reason::kExpired;
    // valid_until_ns_ is later than now_ns; if one of these is absurd, a difference could overflow.
    constexpr std::int64_t kAbsurd = std::numeric_limits<std::int64_t>::max() / 4;
    for (const std::int64_t time : {now_ns, stamp_ns_, valid_until_ns_}) {
      if (time > kAbsurd || time < -kAbsurd) return Reason::kClock;
    }
    const std::int64_t validity_ns = valid_until_ns_ - stamp_ns_;
    if (stamp_ns_ > now_ns + parameters_.future_tolerance_ns || validity_ns <= 0 ||
        validity_ns > kMaxValidityNs) {
      return Reason::kClock;
    }
    if (now_ns - received_ns_ > parameters_.max_silence_ns) return Reason::kSilent;
    return planes_current_ ? Reason::kAllowed : Reason::kOtherPose;
  }

  std::string frame_;
  RuleParameters parameters_;
  bool has_instance_ = false;
  std::array<char, kMaxIdBytes> id_{};
  std::size_t id_bytes_ = 0;
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
};

}  // namespace marginguard
