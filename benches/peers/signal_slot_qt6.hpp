// The objects of the peer on Qt 6; a header because Qt's meta-object compiler reads headers.
#pragma once

#include "sheet.hpp"

#include <QObject>
#include <QString>

#include <atomic>
#include <vector>

class Sender : public QObject {
    Q_OBJECT
Q_SIGNALS:
    void number(qint64 number);
    void text(const QString& text);
};

class Receiver : public QObject {
    Q_OBJECT
public:
    std::int64_t sum = 0;
    std::atomic<std::int64_t> calls{0};
    std::vector<std::int64_t> spans;

public Q_SLOTS:
    void take(qint64 number) { sum += number; }
    void count(qint64 number) {
        sum += number;
        // One thread writes: no more than a load and a store.
        calls.store(calls.load(std::memory_order_relaxed) + 1, std::memory_order_release);
    }
    void read(const QString& text) { sum += text.size(); }
    void arrive(qint64 sent_ns) {
        spans.push_back(sheet::now_ns() - sent_ns);
        calls.fetch_add(1, std::memory_order_release);
    }
};
