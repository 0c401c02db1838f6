// Qt 6: direct and queued calls, across threads, connecting and disconnecting.
#include "signal_slot_qt6.hpp"

#include "sheet.hpp"

#include <QCoreApplication>
#include <QThread>

#include <chrono>
#include <memory>
#include <thread>
#include <vector>

namespace {

void direct(int slots, std::int64_t total) {
    Sender sender;
    std::vector<std::unique_ptr<Receiver>> receivers;
    for (int i = 0; i < slots; ++i) {
        receivers.push_back(std::make_unique<Receiver>());
        Receiver* receiver = receivers.back().get();
        QObject::connect(&sender, &Sender::number, receiver, [receiver](qint64 number) { receiver->take(number); },
                         Qt::DirectConnection);
        QObject::connect(&sender, &Sender::text, receiver, [receiver](const QString& text) { receiver->read(text); },
                         Qt::DirectConnection);
    }
    const std::int64_t emits = total / (slots > 0 ? slots : 1);
    const double calls_each = slots > 0 ? slots : 1;
    double per_emit = sheet::ns_per_unit(emits, [&](std::int64_t count) {
        for (std::int64_t i = 0; i < count; ++i) {
            qint64 number = i;
            sheet::opaque(number);
            Q_EMIT sender.number(number);
        }
    });
    sheet::figure(sheet::direct_case(slots, ""), "ns_per_call", "ns", per_emit / calls_each);
    QString text = QStringLiteral("left wheel");
    per_emit = sheet::ns_per_unit(emits, [&](std::int64_t count) {
        for (std::int64_t i = 0; i < count; ++i) {
            sheet::opaque(text);
            Q_EMIT sender.text(text);
        }
    });
    sheet::figure(sheet::direct_case(slots, "/str"), "ns_per_call", "ns", per_emit / calls_each);
}

void same_thread(bool smoke) {
    const int burst = smoke ? 10 : 10'000, bursts = smoke ? 2 : 50;
    Sender sender;
    Receiver receiver;
    QObject::connect(&sender, &Sender::number, &receiver, &Receiver::count, Qt::QueuedConnection);
    auto round = [&] {
        const std::int64_t goal = receiver.calls.load() + burst;
        for (int i = 0; i < burst; ++i) Q_EMIT sender.number(i);
        while (receiver.calls.load() < goal) QCoreApplication::processEvents();
    };
    const double per_burst = sheet::ns_per_unit(bursts, [&](std::int64_t count) {
        for (std::int64_t i = 0; i < count; ++i) round();
    });
    sheet::figure("queued/same-thread", "ns_per_call", "ns", per_burst / burst);
}

// A receiver on a thread with an event loop.
struct Far {
    QThread thread;
    Receiver receiver;

    Far() {
        receiver.moveToThread(&thread);
        thread.start();
    }
    ~Far() {
        thread.quit();
        thread.wait();
    }
    void wait_for(std::int64_t calls) {
        while (receiver.calls.load(std::memory_order_acquire) < calls) std::this_thread::yield();
    }
};

void cross_thread(bool smoke) {
    const std::int64_t burst = smoke ? 10 : 10'000, bursts = smoke ? 2 : 30;
    Sender sender;
    Far far;
    QObject::connect(&sender, &Sender::number, &far.receiver, &Receiver::count, Qt::QueuedConnection);
    auto round = [&](std::int64_t number) {
        for (std::int64_t i = 0; i < burst; ++i) Q_EMIT sender.number(i);
        far.wait_for(number * burst);
    };
    round(1);
    const std::int64_t began = sheet::now_ns();
    for (std::int64_t number = 2; number <= bursts + 1; ++number) round(number);
    const double took = static_cast<double>(sheet::now_ns() - began);
    sheet::figure("queued/cross-thread", "ns_per_call", "ns", took / static_cast<double>(burst * bursts));
}

void one_way(bool smoke) {
    const int samples = smoke ? 3 : 1000;
    Sender sender;
    Far far;
    QObject::connect(&sender, &Sender::number, &far.receiver, &Receiver::arrive, Qt::QueuedConnection);
    for (int i = 0; i < samples; ++i) {
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
        Q_EMIT sender.number(sheet::now_ns());
    }
    far.wait_for(samples);
    for (std::int64_t ns : far.receiver.spans) sheet::sample("queued/idle-one-way", "", static_cast<std::uint64_t>(ns));
}

void linking(int count) {
    std::vector<std::unique_ptr<Sender>> senders;
    std::vector<std::unique_ptr<Receiver>> receivers;
    for (int i = 0; i < count; ++i) {
        senders.push_back(std::make_unique<Sender>());
        receivers.push_back(std::make_unique<Receiver>());
    }
    std::vector<QMetaObject::Connection> links;
    links.reserve(static_cast<std::size_t>(count));
    std::int64_t began = sheet::now_ns();
    for (std::size_t i = 0; i < senders.size(); ++i) {
        Receiver* receiver = receivers[i].get();
        links.push_back(QObject::connect(senders[i].get(), &Sender::number, receiver,
                                         [receiver](qint64 number) { receiver->take(number); }, Qt::DirectConnection));
    }
    sheet::figure("attach", "ns_per_call", "ns", static_cast<double>(sheet::now_ns() - began) / count);
    began = sheet::now_ns();
    for (auto& link : links) QObject::disconnect(link);
    sheet::figure("detach", "ns_per_call", "ns", static_cast<double>(sheet::now_ns() - began) / count);
}

}  // namespace

int main(int count, char** words) {
    QCoreApplication app(count, words);
    const bool smoke = sheet::is_smoke(count, words);
    for (int slots : {0, 1, 10, 100}) direct(slots, smoke ? 1000 : 5'000'000);
    same_thread(smoke);
    linking(smoke ? 10 : 100'000);
    cross_thread(smoke);
    one_way(smoke);
    return 0;
}
