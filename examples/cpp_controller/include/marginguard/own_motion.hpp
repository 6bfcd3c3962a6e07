// What a controller has commanded since the poses of a constraint were measured.
//
// C++17 standard library only; no dynamic memory, no exceptions, bounded run time. SI units, ns.
// As OwnMotion in Python (app/fixture/control/own_motion.py).
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "marginguard/nearest_twist.hpp"

namespace marginguard {

constexpr std::int64_t kNsPerMs = 1'000'000;
constexpr std::int64_t kNsPerS = 1'000'000'000;
constexpr std::int64_t kMaxTimeNs = std::numeric_limits<std::int64_t>::max() / 4;
constexpr std::int64_t kMaxValidityNs = 10 * kNsPerS;  // the largest stale_after_ms of a guard
constexpr std::size_t kKeptIntervals = 128;
constexpr std::int64_t kIntervalNs = 4 * kNsPerMs;  // commands within it are one interval

// The commanded motion of the last intervals: at least 0.25 s, at any control rate. The tool
// stands before the first call. After `forget`, and after time has run backwards, nothing is known
// of what was commanded before `known_from_ns`.
class OwnMotion {
 public:
  // From `now_ns` on the tool moves with `twist` of its tip.
  void command(const Vector6& twist, std::int64_t now_ns) {
    hold_until(now_ns);
    twist_ = twist;
  }

  // Adds the motion by the last command until `now_ns`. If time has run backwards, nothing is known
  // of what was commanded before, up to the time that it was: a stamp before that may be of the time
  // before the jump. A guard repeats such a message for kMaxValidityNs at most.
  void hold_until(std::int64_t now_ns) {
    now_ns = std::clamp(now_ns, -kMaxTimeNs, kMaxTimeNs);  // differences must not overflow
    if (!has_from_) from_ns_ = now_ns;
    has_from_ = true;
    if (now_ns < from_ns_) begin(std::min(from_ns_, now_ns + kMaxValidityNs));
    const std::int64_t elapsed_ns = now_ns - from_ns_;
    from_ns_ = now_ns;
    if (elapsed_ns <= 0) return;
    std::size_t last = (next_ + kKeptIntervals - 1) % kKeptIntervals;
    if (count_ == 0 || now_ns - kept_[last].begin_ns > kIntervalNs) {
      last = next_;
      next_ = (next_ + 1) % kKeptIntervals;
      count_ = std::min(count_ + 1, kKeptIntervals);
      kept_[last] = Interval{};
      kept_[last].begin_ns = now_ns - elapsed_ns;
    }
    const double elapsed_s = static_cast<double>(elapsed_ns) / static_cast<double>(kNsPerS);
    Interval& interval = kept_[last];
    interval.end_ns = now_ns;
    for (std::size_t k = 0; k < 6; ++k) interval.moved[k] += twist_[k] * elapsed_s;
    interval.way += std::hypot(twist_[0], twist_[1], twist_[2]) * elapsed_s;
    interval.turn += std::hypot(twist_[3], twist_[4], twist_[5]) * elapsed_s;
  }

  // Forgets what was commanded up to `now_ns`: it was along other axes.
  void forget(std::int64_t now_ns) {
    hold_until(now_ns);
    begin(from_ns_);
  }

  std::int64_t known_from_ns() const { return known_from_ns_; }

  // True if all commands from `since_ns` on are remembered.
  bool knows(std::int64_t since_ns) const {
    return known_from_ns_ <= since_ns &&
           (count_ < kKeptIntervals || kept_[next_].begin_ns <= since_ns);
  }

  // Where the commands since then have moved the tip to; no bound.
  Vector3 shift(std::int64_t since_ns) const {
    Vector3 found{};
    for (std::size_t i = 0; i < count_; ++i) {
      for (std::size_t k = 0; k < 3 && kept_[i].end_ns > since_ns; ++k) {
        found[k] += kept_[i].moved[k];
      }
    }
    return found;
  }

  // The motion from `stamp_ns` to `now_ns`, and by commands of `lag_ns` before that: a command has
  // its effect within `lag_ns`. Motion away from a plane is not counted: it may not have happened
  // yet. `origin` is the tip at `stamp_ns`.
  Moved since(std::int64_t stamp_ns, std::int64_t lag_ns, std::int64_t now_ns,
              const std::array<HalfSpace, kMaxPlanes>& planes, std::size_t count,
              const Vector3& origin) const {
    count = std::min(count, kMaxPlanes);
    Moved found;
    std::array<Vector3, kMaxPlanes> levers{};
    for (std::size_t p = 0; p < count; ++p) {
      for (std::size_t k = 0; k < 3; ++k) levers[p][k] = planes[p].point_on_tool[k] - origin[k];
    }
    for (std::size_t i = 0; i < count_; ++i) {
      const Interval& interval = kept_[i];
      if (interval.end_ns <= stamp_ns - lag_ns) continue;
      const Vector6& moved = interval.moved;
      found.way += interval.way;
      found.turn += interval.turn;
      for (std::size_t p = 0; p < count; ++p) {
        const Vector3& lever = levers[p];
        const Vector3 shift{moved[0] + moved[4] * lever[2] - moved[5] * lever[1],
                            moved[1] + moved[5] * lever[0] - moved[3] * lever[2],
                            moved[2] + moved[3] * lever[1] - moved[4] * lever[0]};
        // In this order NaN stays NaN.
        found.approach[p] += std::max(-detail::dot(planes[p].normal, shift), 0.0);
      }
    }
    const double age_s = static_cast<double>(std::max<std::int64_t>(now_ns - stamp_ns, 0)) /
                         static_cast<double>(kNsPerS);
    for (std::size_t p = 0; p < count; ++p) {
      // n . (R - 1) r differs from n . (w x r) by at most half the squared angle times |r|.
      const double reach = std::sqrt(detail::dot(levers[p], levers[p]));
      found.approach[p] += 0.5 * found.turn * found.turn * reach;
      const double tumor = detail::dot(planes[p].normal, planes[p].tumor_velocity);
      found.approach[p] += std::max(tumor, 0.0) * age_s;
    }
    return found;
  }

 private:
  void begin(std::int64_t known_from_ns) {
    count_ = next_ = 0;
    known_from_ns_ = known_from_ns;
  }

  struct Interval {
    std::int64_t begin_ns = 0;
    std::int64_t end_ns = 0;
    Vector6 moved{};
    double way = 0.0;
    double turn = 0.0;
  };

  std::array<Interval, kKeptIntervals> kept_{};
  std::size_t count_ = 0;
  std::size_t next_ = 0;  // the oldest one, once all are used
  Vector6 twist_{};
  bool has_from_ = false;
  std::int64_t from_ns_ = 0;
  std::int64_t known_from_ns_ = -kMaxTimeNs;
};

}  // namespace marginguard
