// A device of two axes in a program of its own, each a weight on a damped rail that nobody holds.
// `device ENDPOINT [--once]`; see forcebound_device.hpp, and kind: program in device.yaml.
#include "forcebound_device.hpp"

struct Rails : forcebound::Device {
  double x[2] = {0.0, 0.0}, v[2] = {0.0, 0.1}, force[2] = {0.0, 0.0}, time = now();
  const double mass = 0.1, damping = 0.5;  // kg, N s/m

  static double now() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
  }

  void move() {
    const double before = time, dt = (time = now()) - before;
    for (int i = 0; i < 2; i++) {
      v[i] = (mass * v[i] + dt * (force[i] + 0.3 * (i == 0))) / (mass + dt * damping);  // 0.3 N along x
      x[i] += dt * v[i];
    }
  }
  std::vector<double> read() override {
    move();
    return {x[0], x[1]};
  }
  void write(const std::vector<double>& wanted) override {
    move();
    force[0] = wanted[0], force[1] = wanted[1];
  }
  void stop() override { std::cout << "the rails rest" << std::endl; }
};

int main(int argc, char** argv) {
  Rails rails;
  return forcebound::serve(rails, 2, argc, argv);
}
