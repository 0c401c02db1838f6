// Direct calls and linking, for libraries whose signal is a function object: `Signal<void(long)>`.
//
// A library is described by a class with the two kinds of signal, a way to connect and one to disconnect.
#pragma once

#include "sheet.hpp"

#include <memory>
#include <vector>

namespace direct {

struct Receiver {
    std::int64_t sum = 0;
    void take(std::int64_t number) { sum += number; }
    void read(const std::string& text) { sum += static_cast<std::int64_t>(text.size()); }
};

template <typename Library>
void calls(int slots, std::int64_t total) {
    typename Library::Numbers numbers;
    typename Library::Texts texts;
    std::vector<std::unique_ptr<Receiver>> receivers;
    for (int i = 0; i < slots; ++i) {
        receivers.push_back(std::make_unique<Receiver>());
        Receiver* receiver = receivers.back().get();
        Library::connect(numbers, [receiver](std::int64_t number) { receiver->take(number); });
        Library::connect(texts, [receiver](const std::string& text) { receiver->read(text); });
    }
    const std::int64_t emits = total / (slots > 0 ? slots : 1);
    const double calls_each = slots > 0 ? slots : 1;
    double per_emit = sheet::ns_per_unit(emits, [&](std::int64_t count) {
        for (std::int64_t i = 0; i < count; ++i) {
            std::int64_t number = i;
            sheet::opaque(number);
            numbers(number);
        }
    });
    sheet::figure(sheet::direct_case(slots, ""), "ns_per_call", "ns", per_emit / calls_each);
    std::string text = "left wheel";
    per_emit = sheet::ns_per_unit(emits, [&](std::int64_t count) {
        for (std::int64_t i = 0; i < count; ++i) {
            sheet::opaque(text);
            texts(text);
        }
    });
    sheet::figure(sheet::direct_case(slots, "/str"), "ns_per_call", "ns", per_emit / calls_each);
}

template <typename Library>
void linking(int count) {
    std::vector<std::unique_ptr<typename Library::Numbers>> senders;
    std::vector<std::unique_ptr<Receiver>> receivers;
    for (int i = 0; i < count; ++i) {
        senders.push_back(std::make_unique<typename Library::Numbers>());
        receivers.push_back(std::make_unique<Receiver>());
    }
    std::vector<typename Library::Connection> links;
    links.reserve(static_cast<std::size_t>(count));
    std::int64_t began = sheet::now_ns();
    for (int i = 0; i < count; ++i) {
        Receiver* receiver = receivers[static_cast<std::size_t>(i)].get();
        auto call = [receiver](std::int64_t number) { receiver->take(number); };
        links.push_back(Library::connect(*senders[static_cast<std::size_t>(i)], call));
    }
    sheet::figure("attach", "ns_per_call", "ns", static_cast<double>(sheet::now_ns() - began) / count);
    began = sheet::now_ns();
    for (auto& link : links) link.disconnect();
    sheet::figure("detach", "ns_per_call", "ns", static_cast<double>(sheet::now_ns() - began) / count);
}

template <typename Library>
int measure(int count, char** words) {
    const bool smoke = sheet::is_smoke(count, words);
    for (int slots : {0, 1, 10, 100}) calls<Library>(slots, smoke ? 1000 : 20'000'000);
    linking<Library>(smoke ? 10 : 100'000);
    return 0;
}

}  // namespace direct
