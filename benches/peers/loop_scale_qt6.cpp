// A round of Qt's event loop with idle sockets, timers and objects.
#include "sheet.hpp"

#include <QCoreApplication>
#include <QObject>
#include <QSocketNotifier>
#include <QTimer>

#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include <memory>
#include <vector>

namespace {

double round_ns(bool smoke, int idle) {
    const int rounds = smoke ? 10 : (idle >= 1000 ? 2'000 : 20'000);
    return sheet::ns_per_unit(rounds, [](std::int64_t count) {
        for (std::int64_t i = 0; i < count; ++i) QCoreApplication::processEvents();
    });
}

void tell(const char* what, int idle, bool smoke) {
    const std::string name = std::string("loop/") + what + "/" + std::to_string(idle);
    sheet::figure(name, "pulse_ns", "ns", round_ns(smoke, idle));
}

int udp_socket() {
    const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    sockaddr_in at{};
    at.sin_family = AF_INET;
    at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (fd < 0 || bind(fd, reinterpret_cast<sockaddr*>(&at), sizeof at) != 0) {
        std::perror("a socket");
        std::exit(1);
    }
    return fd;
}

void sockets(int idle, bool smoke) {
    std::vector<int> fds;
    std::vector<std::unique_ptr<QSocketNotifier>> notifiers;
    for (int i = 0; i < idle; ++i) {
        fds.push_back(udp_socket());
        notifiers.push_back(std::make_unique<QSocketNotifier>(fds.back(), QSocketNotifier::Read));
    }
    tell("sockets", idle, smoke);
    notifiers.clear();
    for (int fd : fds) close(fd);
}

void timers(int idle, bool smoke) {
    std::vector<std::unique_ptr<QTimer>> timers;
    for (int i = 0; i < idle; ++i) {
        timers.push_back(std::make_unique<QTimer>());
        timers.back()->start(3'600'000 + i);
    }
    tell("timers", idle, smoke);
}

void objects(int idle, bool smoke) {
    std::vector<std::unique_ptr<QObject>> objects;
    for (int i = 0; i < idle; ++i) objects.push_back(std::make_unique<QObject>());
    tell("objects", idle, smoke);
}

}  // namespace

int main(int count, char** words) {
    QCoreApplication app(count, words);
    const bool smoke = sheet::is_smoke(count, words);
    sheet::figure("loop/empty", "pulse_ns", "ns", round_ns(smoke, 0));
    for (int idle : {10, 100, 1'000, 10'000}) {
        if (smoke && idle > 10) break;
        sockets(idle, smoke);
        timers(idle, smoke);
        objects(idle, smoke);
    }
    return 0;
}
