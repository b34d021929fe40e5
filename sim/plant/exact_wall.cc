#include "sim/plant/exact_wall.h"

namespace twoport::sim {

template <int D>
bool ExactPlant<D>::contact_at_turn(const Normal& from, const Vector& u, double h) const noexcept {
  const AxisState at = free_across(from, u, turn(from, u, h));
  return contact({at.x, at.v});
}
template <int D>
AxisState ExactPlant<D>::free_across(const Normal& from, const Vector& u, double t) const noexcept {
  return propagate(region_[0].across, {from[0], from[1]}, normal_.dot(u), 0.0, t);
}
template <int D>
double ExactPlant<D>::turn(const Normal& from, const Vector& u, double h) const noexcept {
  double lo = 0.0, hi = h;
  for (int i = 0; i < 60; ++i) {
    const double t = 0.5 * (lo + hi);
    (free_across(from, u, t).v < 0.0 ? lo : hi) = t;
  }
  return hi;
}

template <int D>
void ExactPlant<D>::step_in_parts(Vector u) noexcept {
  double left = dt_;
  bool in = s_.in_contact;
  for (int cuts = 0; left > 0.0;) {
    double h = std::min(left, region_[in].span);
    BodyState<D> next = moved(s_.body, u, in, h);
    const Normal from = normal(s_.body), to = normal(next);
    const bool dips = !in && from[1] < 0.0 && to[1] > 0.0 && !contact(to);
    if (cuts < kCuts && (contact(to) != in || (dips && contact_at_turn(from, u, h)))) {
      ++cuts;
      h = crossing(in, s_.body, u, dips ? turn(from, u, h) : h);
      next = moved(s_.body, u, in, h);
      in = !in;
    }
    s_.body = next;
    left -= h;
  }
  s_.across = normal(s_.body);
  s_.in_contact = contact(s_.across);
  if (rough_) note_friction(u);
}
template <int D>
BodyState<D> ExactPlant<D>::moved(const BodyState<D>& s, const Vector& u, bool in, double h) const noexcept {
  const Region& r = region_[in];
  const bool whole = h == r.span;
  const Normal from = normal(s);
  const Map map = whole ? r.map : Map{Response{r.across, h}, r.across};
  if (rough_ && in) {
    const Normal to = map(from, normal_.dot(u) + r.load);
    Vector x = along(s.x.translation()), v = along(s.v.vec());
    friction_.advance(x, v, along(u), normal_.dot(u), {from[0], from[1]}, h);
    return {Position<D>{x + to[0] * normal_}, Velocity<D>{v + to[1] * normal_}};
  }
  const Response along = D == 1 || whole ? r.full_along : Response{r.along, h};
  return moved(s, from, map(from, normal_.dot(u) + r.load), u, r, along);
}

template <int D>
double ExactPlant<D>::crossing(bool in, const BodyState<D>& s, const Vector& u, double h) const noexcept {
  const Oscillator& o = region_[in].across;
  const Normal n = normal(s);
  const double load = normal_.dot(u) + region_[in].load - o.stiffness_n_per_m * n[0];
  const auto pressed = [&](double t) {
    const AxisState d = propagate(o, {0, n[1]}, load, 0, t);
    const double elastic = k_ * (offset_ - n[0] - d.x);
    return std::min(elastic, elastic - b_ * d.v);
  };
  double lo = 0.0, hi = h, at_lo = std::copysign(pressed(lo), in ? 1.0 : -1.0), at_hi = pressed(hi);
  for (int i = 0, stuck = 0; i < 120 && hi - lo > 1e-13 * h; ++i) {
    const double secant = hi - at_hi * (hi - lo) / (at_hi - at_lo), inset = 0.4e-13 * h;
    const double t = std::clamp(std::isfinite(secant) && i < 60 ? secant : 0.5 * (lo + hi), lo + inset, hi - inset);
    const double at = pressed(t);
    if ((at > 0.0) == in) {
      lo = t, at_lo = at;
      if (stuck < 0) at_hi *= 0.5;
      stuck = -1;
    } else {
      hi = t, at_hi = at;
      if (stuck > 0) at_lo *= 0.5;
      stuck = 1;
    }
  }
  return hi;
}

template class ExactPlant<1>;
template class ExactPlant<3>;

}  // namespace twoport::sim
