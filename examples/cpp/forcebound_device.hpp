// A device of forcebound in a program of your own: CHAI3D, Force Dimension, Touch, a robot.
// One header, C++17, libzmq (-lzmq). Derive from forcebound::Device, and call serve() in main:
//
//   struct MyDevice : forcebound::Device {
//     std::vector<double> read() override { ... }              // m of a length, rad of an angle
//     void write(const std::vector<double>& force) override {}  // N, N m; positive accelerates
//   };                                                          // towards larger positions
//   int main(int argc, char** argv) { MyDevice device; return forcebound::serve(device, 3, argc, argv); }
//
// The bounder is not here: it runs in forcebound's device process, which calls read and write over
// a socket and bounds each force before it comes here (`kind: program` in a launch file).
//
// The watchdog: when no message has come for half of the launch file's watchdog_limit while a force
// is on, serve() writes zero force by itself, refuses what comes later, and so ends the run. It
// promises that as long as this process runs and read and write return. It promises nothing when
// the process hangs, is stopped or is killed: then only the device's own watchdog ends a force.
//
// Messages: a REP socket; 4 bytes FBD1, 4 of the kind, then doubles, as this machine has them.
// hello: axes, seconds of the watchdog. read, writ, stop: as named. Answers: okay, with positions
// after a read; fail, with a text.
#pragma once
#include <zmq.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstring>
#include <iostream>
#include <stdexcept>
#include <string>
#include <vector>

namespace forcebound {

struct Device {
  virtual ~Device() = default;
  virtual std::vector<double> read() = 0;                   // one position for each axis, a new one
  virtual void write(const std::vector<double>& force) = 0;  // one force for each axis
  virtual void stop() {}                                    // last, after zero force
};

namespace detail {

constexpr char MAGIC[] = "FBD1";
constexpr double SILENT = 2.0;  // s, after which a program that forcebound started ends
inline volatile std::sig_atomic_t stopped = 0;

inline double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

struct Closed {  // what is closed when it goes
  void* context = zmq_ctx_new();
  void* socket = zmq_socket(context, ZMQ_REP);
  ~Closed() { zmq_close(socket), zmq_ctx_term(context); }
};

class Server {
 public:
  Server(Device& device, std::size_t axes, bool ends) : device_(device), zero_(axes, 0.0), ends_(ends) {}

  void run(void* socket) {
    std::vector<char> message(8 + 8 * 64);
    while (!stopped && !is_over_) {
      zmq_pollitem_t item{socket, 0, ZMQ_POLLIN, 0};
      if (zmq_poll(&item, 1, wait()) < 0 && zmq_errno() != EINTR) throw std::runtime_error(zmq_strerror(zmq_errno()));
      watch();
      if (!(item.revents & ZMQ_POLLIN)) continue;
      const int size = zmq_recv(socket, message.data(), message.size(), 0);
      if (size < 0) continue;
      const std::string answer = reply(message.data(), static_cast<std::size_t>(size));
      zmq_send(socket, answer.data(), answer.size(), 0);
    }
    end();
  }

  void end() {  // once: zero force, then stop
    if (is_ended_) return;
    is_ended_ = true;
    device_.write(zero_);
    device_.stop();
  }

 private:
  long wait() const {  // ms, until the watchdog may have to act
    return has_force_ ? std::max(1L, std::lround(1e3 * (heard_ + limit_ - now()))) : 50;
  }

  void watch() {
    const double silent = now() - heard_;
    if (has_force_ && silent > limit_) {
      device_.write(zero_);
      has_force_ = false;
      fired_ = "no message for " + std::to_string(std::lround(1e3 * silent)) + " ms with a force on: zero force was written";
      std::cerr << fired_ << std::endl;
    }
    if (ends_ && heard_ > 0.0 && silent > SILENT) is_over_ = true;
  }

  std::string reply(const char* data, std::size_t size) try {
    if (size < 8 || size % 8 || std::memcmp(data, MAGIC, 4)) throw std::runtime_error("no message of forcebound");
    const std::string kind(data + 4, 4);
    std::vector<double> numbers(size / 8 - 1);
    std::memcpy(numbers.data(), data + 8, size - 8);
    heard_ = now();
    if (kind == "helo") {
      if (numbers.size() != 2 || numbers[0] != static_cast<double>(zero_.size()))
        throw std::runtime_error("this device has " + std::to_string(zero_.size()) + " axes");
      limit_ = 0.5 * numbers[1];
      device_.write(zero_);
      fired_.clear(), has_force_ = false;
      return std::string(MAGIC) + "okay";
    }
    if (kind == "stop") {
      end();
      is_over_ = ends_;
      is_ended_ = is_over_;  // else the next hello serves again
      return std::string(MAGIC) + "okay";
    }
    if (!fired_.empty()) throw std::runtime_error(fired_);
    if (kind == "read") {
      const std::vector<double> at = device_.read();
      if (at.size() != zero_.size()) throw std::runtime_error("read() returned " + std::to_string(at.size()) + " positions");
      return std::string(MAGIC) + "okay" + std::string(reinterpret_cast<const char*>(at.data()), 8 * at.size());
    }
    if (kind != "writ" || numbers.size() != zero_.size()) throw std::runtime_error("unknown message " + kind);
    for (const double force : numbers)
      if (!std::isfinite(force)) throw std::runtime_error("a force that is no number");
    has_force_ = numbers != zero_;  // before the write: it counts also if that fails
    device_.write(numbers);
    return std::string(MAGIC) + "okay";
  } catch (const std::exception& error) {
    if (has_force_) {  // whatever failed, no force stays
      has_force_ = false;
      try { device_.write(zero_); } catch (const std::exception&) {}
    }
    return std::string(MAGIC) + "fail" + error.what();
  }

  Device& device_;
  const std::vector<double> zero_;
  const bool ends_;  // with the process that started it
  bool has_force_ = false, is_over_ = false, is_ended_ = false;
  double heard_ = 0.0, limit_ = 0.05;  // s
  std::string fired_;  // what the watchdog has to say; empty: it did nothing
};

}  // namespace detail

// Serves one graph after the other at the endpoint argv[1] (ipc:// or tcp://), until SIGINT or
// SIGTERM; with --once, as forcebound starts it, until that graph ends. Returns the exit status.
inline int serve(Device& device, std::size_t axes, int argc, char** argv) try {
  if (argc < 2 || argc > 3 || axes < 1) throw std::invalid_argument("usage: ENDPOINT [--once], such as tcp://127.0.0.1:7601");
  for (int signal : {SIGINT, SIGTERM}) std::signal(signal, [](int) { detail::stopped = 1; });
  detail::Closed zmq;
  const int none = 0;
  const int64_t most = 8 + 8 * 64;
  zmq_setsockopt(zmq.socket, ZMQ_LINGER, &none, sizeof none);
  zmq_setsockopt(zmq.socket, ZMQ_MAXMSGSIZE, &most, sizeof most);
  if (zmq_bind(zmq.socket, argv[1])) throw std::runtime_error(std::string("cannot bind to ") + argv[1] + ": " + zmq_strerror(zmq_errno()));
  detail::Server server(device, axes, argc == 3);
  try {
    server.run(zmq.socket);
  } catch (...) {
    server.end();
    throw;
  }
  return 0;
} catch (const std::exception& error) {
  return std::cerr << argv[0] << ": " << error.what() << std::endl, 2;
}

}  // namespace forcebound
