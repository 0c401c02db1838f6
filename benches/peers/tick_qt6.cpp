// A precise QTimer: how late each timeout comes after the one before it and an interval.
//
//   tick_qt6 CASE INTERVAL_US SECONDS
#include "sheet.hpp"

#include <QCoreApplication>
#include <QTimer>

#include <cstdlib>
#include <vector>

int main(int count, char** words) {
    QCoreApplication app(count, words);
    if (count < 4) return 2;
    const std::string name = words[1];
    const std::int64_t interval_ns = std::atoll(words[2]) * 1000;
    const auto wanted = static_cast<std::size_t>(std::atof(words[3]) * 1e9 / static_cast<double>(interval_ns));
    std::vector<std::int64_t> ticks;
    ticks.reserve(wanted + 1);
    QTimer timer;
    timer.setTimerType(Qt::PreciseTimer);
    QObject::connect(&timer, &QTimer::timeout, &app, [&] {
        ticks.push_back(sheet::now_ns());
        if (ticks.size() > wanted) QCoreApplication::quit();
    });
    // QTimer counts whole milliseconds; below one it can only run without a wait.
    if (interval_ns < 1'000'000) {
        std::fprintf(stderr, "QTimer has no interval below a millisecond\n");
        return 2;
    }
    timer.start(std::chrono::milliseconds(interval_ns / 1'000'000));
    QCoreApplication::exec();
    for (std::size_t i = 1; i < ticks.size(); ++i) {
        const std::int64_t late = ticks[i] - ticks[i - 1] - interval_ns;
        sheet::sample(name, "wake_error", static_cast<std::uint64_t>(late > 0 ? late : 0));
    }
    const double period = static_cast<double>(ticks.back() - ticks.front()) / static_cast<double>(ticks.size() - 1);
    sheet::figure(name, "drift", "ppm", (period / static_cast<double>(interval_ns) - 1.0) * 1e6);
    const double passed = static_cast<double>(ticks.back() - ticks.front()) / static_cast<double>(interval_ns);
    const double missed = passed - static_cast<double>(ticks.size() - 1);
    sheet::figure(name, "missed", "1", missed > 0.5 ? missed : 0.0);
    return 0;
}
