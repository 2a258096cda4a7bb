// A virtual wall that serves a forcebound graph over TCP; written from docs/protocol.md.
// `wall ADDRESS PORT [STIFFNESS SURFACE [KEY_FILE GRAPH_KEY]]`: the graph listens there; stiffness in
// N/m, surface in m; KEY_FILE is our NAME.key_secret, GRAPH_KEY a NAME.key or its 40 characters.
#include <chrono>
#include <csignal>
#include <fstream>
#include <iostream>
#include <msgpack.hpp>
#include <optional>
#include <random>
#include <sstream>
#include <zmq.hpp>
using Text = std::string;
using Refused = std::invalid_argument;
constexpr int64_t SECOND = 1'000'000'000;  // ns
volatile std::sig_atomic_t stopped = 0;

struct Query {
  uint64_t seq, time_ns, device_seq, device_time_ns;
  double elapsed;
  std::vector<double> position;
  Text environment;  // empty: nobody serves
  Text hand;  // copied into the answer
};
int64_t now() { return std::chrono::steady_clock::now().time_since_epoch() / std::chrono::nanoseconds(1); }

// Return a key: the characters themselves, or the one named `kind` in a key file.
Text key_of(const Text& text, const Text& kind) {
  std::ifstream file(text);
  if (!file && text.size() == 40) return text;
  const Text content{std::istreambuf_iterator<char>(file), {}}, before = kind + " = \"";
  if (const auto at = content.find(before); at != Text::npos) return content.substr(at + before.size(), 40);
  throw std::runtime_error(text + " is no file with a " + kind);
}

// Return the query in a message, or throw the reason why there is none.
Query read(const zmq::message_t& frame) {
  std::size_t end = 0;
  if (frame.size() > 8192 || frame.more()) throw Refused("malformed: over 8192 bytes, or several frames");
  const auto whole = msgpack::unpack(frame.data<char>(), frame.size(), end);
  const auto map = whole->as<std::map<Text, msgpack::object>>();
  if (map.at("version").as<uint64_t>() != 5) throw Refused("version: this program speaks 5");
  if (end != frame.size() || map.at("packet").as<Text>() != "environment_query")
    throw Refused("another packet, or trailing bytes");  // keys that we do not know are ignored
  const auto count = [&](const char* key) { return map.at(key).as<uint64_t>(); };
  const auto vector = [&](const char* key) { return map.at(key).as<std::vector<double>>(); };
  const auto& environment = map.at("environment");
  const Query query{count("seq"), count("time_ns"), count("device_seq"), count("device_time_ns"),
    map.at("elapsed").as<double>(), vector("position"), environment.is_nil() ? "" : environment.as<Text>(),
    map.count("hand") ? map.at("hand").as<Text>() : "hand"};
  const auto axes = query.position.size(), speeds = vector("velocity").size();
  if ((query.seq | query.time_ns | query.device_seq | query.device_time_ns) >> 63 || axes < 1 || axes > 6 ||
      speeds != axes || environment.is_nil() != query.environment.empty()) throw Refused("value: out of range");
  return query;
}

int main(int argc, char** argv) try {
  if (argc < 3 || argc > 7 || argc % 2 == 0) throw Refused("usage: ADDRESS PORT [STIFFNESS SURFACE [KEY_FILE GRAPH_KEY]]");
  const auto number = [&](int place, auto least, auto most, const char* expected) {
    std::istringstream word(argv[place]);  // all of it, in the classic locale
    if (decltype(least) value; word >> value && word.eof() && value >= least && value <= most) return value;
    throw Refused(Text("expected ") + expected + ", got '" + argv[place] + "'");
  };
  const int port = number(2, 1, 65535, "PORT, a whole number from 1 to 65535");
  const double stiffness = argc > 4 ? number(3, 0.0, 1e9, "STIFFNESS in N/m, a number from 0 to 1e9") : 10'000;
  const double surface = argc > 4 ? number(4, -1.0, 1.0, "SURFACE in m, a number from -1 to 1") : 0.01;
  const Text name = "cpp-wall-" + std::to_string(std::random_device{}()) + "-" + std::to_string(std::random_device{}());
  const auto say = [&](const auto&... words) { ((std::cout << name << ": ") << ... << words) << std::endl; };
  const Text endpoint = "tcp://" + Text(argv[1]) + ":" + std::to_string(port);
  zmq::context_t context;
  zmq::socket_t socket(context, zmq::socket_type::dealer);
  socket.set(zmq::sockopt::linger, 0), socket.set(zmq::sockopt::immediate, true), socket.set(zmq::sockopt::ipv6, true);
  socket.set(zmq::sockopt::maxmsgsize, int64_t{65536}), socket.set(zmq::sockopt::rcvtimeo, 200);  // ms
  if (argc == 7) {
    socket.set(zmq::sockopt::curve_serverkey, key_of(argv[6], "public-key"));
    socket.set(zmq::sockopt::curve_publickey, key_of(argv[5], "public-key"));
    socket.set(zmq::sockopt::curve_secretkey, key_of(argv[5], "secret-key"));
  }
  socket.connect(endpoint);  // after all of these
  for (int signal : {SIGINT, SIGTERM}) std::signal(signal, [](int) { stopped = 1; });
  say("a wall of ", stiffness, " N/m at ", surface, " m, for the graph at ", endpoint);
  int64_t answered = 0, dropped = 0, heard_at = now(), answered_at = 0;
  std::optional<Text> serving;
  while (!stopped) {
    std::optional<Query> newest;  // the last readable one of all that wait; a flood cannot keep us taking
    for (int taken = 0; taken < 1000; taken++) try {
        zmq::message_t frame, further;
        if (zmq_msg_recv(frame.handle(), socket.handle(), taken ? ZMQ_DONTWAIT : 0) < 0) break;  // none, or a signal
        for (bool more = frame.more(); more; more = further.more()) (void)socket.recv(further);
        if (frame.size() == 0 && !frame.more()) continue;  // a greeting
        newest = read(frame);
      } catch (const std::exception& reason) {
        if (++dropped % 1000 == 1) say("dropped ", dropped, " so far: ", reason.what());
      }
    if (!newest) socket.send(zmq::message_t(), zmq::send_flags::dontwait);  // greets: the graph sends to who has sent
    if (!newest && now() - heard_at > 3 * SECOND) {  // once refused, ZeroMQ does not try again
      heard_at = now(), say("no query for 3 s; is the graph there, and does it let our key in? Its log tells");
      socket.disconnect(endpoint), socket.connect(endpoint);
    }
    if (!newest) continue;
    const auto& [seq, time_ns, device_seq, device_time_ns, elapsed, position, environment, hand] = *newest;
    const bool refused = !environment.empty() && environment != name;
    if (environment != serving) say(refused ? "refused: " : "", environment.empty() ? "nobody" : environment, " serves the graph");
    serving = environment, heard_at = now();
    if (refused && heard_at - answered_at < SECOND) continue;
    // The wall faces the first axis: f = k (x - x_w) inside, 0 outside and on the other axes.
    const bool inside = position[0] > surface;
    std::vector<double> force(position.size(), 0.0), normal = force, proxy = position;
    if (inside) force[0] = stiffness * (position[0] - surface), proxy[0] = surface, normal[0] = -1.0;
    msgpack::sbuffer bytes;
    msgpack::packer<msgpack::sbuffer> packer(bytes);
    const auto pack = [&](auto key, const auto& value) { packer.pack(key), packer.pack(value); };
    packer.pack_map(13), pack("packet", "environment_reply"), pack("version", 5), pack("hand", hand), pack("seq", answered++);
    pack("time_ns", now()), pack("force", force), pack("environment", name), pack("query_seq", seq);
    pack("query_time_ns", time_ns), pack("device_seq", device_seq), pack("device_time_ns", device_time_ns);
    if (inside) pack("proxy", proxy), pack("normal", normal);  // the contact, which an environment may tell
    else pack("proxy", msgpack::type::nil_t()), pack("normal", msgpack::type::nil_t());
    socket.send(zmq::buffer(bytes.data(), bytes.size()), zmq::send_flags::dontwait), answered_at = now();
  }
  say(answered, " answered, ", dropped, " dropped");
} catch (const std::exception& error) { return std::cerr << "wall: " << error.what() << std::endl, 2; }
