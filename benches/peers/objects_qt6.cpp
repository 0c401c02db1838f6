// QObject: made, connected, buried; flat, as a chain, and children in random order.
#include "objects_qt6.hpp"

#include "sheet.hpp"

#include <QCoreApplication>
#include <QThread>

#include <algorithm>
#include <random>
#include <vector>

namespace {

// Each way is measured in a process of its own, because memory that was used once stays with the process.
void flat(int count, bool connected) {
    const char* name = connected ? "objects/connected" : "objects/flat";
    Object common;
    std::vector<Object*> objects;
    objects.reserve(static_cast<std::size_t>(count));
    // The table of pointers is touched before, so that only the objects are counted.
    objects.resize(static_cast<std::size_t>(count), nullptr);
    const double before = sheet::resident_bytes();
    std::int64_t began = sheet::now_ns();
    for (auto& object : objects) {
        object = new Object;
        if (connected) {
            QObject::connect(object, &Object::number, &common, [&common](qint64 n) { common.take(n); },
                             Qt::DirectConnection);
        }
    }
    sheet::figure(name, "create_ns", "ns", static_cast<double>(sheet::now_ns() - began) / count);
    sheet::figure(name, "bytes", "B", (sheet::resident_bytes() - before) / count);
    began = sheet::now_ns();
    for (Object* object : objects) object->deleteLater();
    while (Object::living() > 1) QCoreApplication::sendPostedEvents(nullptr, QEvent::DeferredDelete);
    sheet::figure(name, "bury_ns", "ns", static_cast<double>(sheet::now_ns() - began) / count);
}

void chain(int depth) {
    const double before = sheet::resident_bytes();
    std::int64_t began = sheet::now_ns();
    auto* root = new Object;
    Object* last = root;
    for (int i = 1; i < depth; ++i) last = new Object(last);
    sheet::figure("objects/chain", "create_ns", "ns", static_cast<double>(sheet::now_ns() - began) / depth);
    sheet::figure("objects/chain", "bytes", "B", (sheet::resident_bytes() - before) / depth);
    began = sheet::now_ns();
    delete root;
    sheet::figure("objects/chain", "bury_ns", "ns", static_cast<double>(sheet::now_ns() - began) / depth);
}

// The destructors nest as deep as the chain: an ordinary stack would overflow.
void chain_on_a_large_stack(int depth) {
    QThread* thread = QThread::create([depth] { chain(depth); });
    thread->setStackSize(1U << 30);
    thread->start();
    thread->wait();
    delete thread;
}

void random_order(int count) {
    Object parent;
    std::vector<Object*> children;
    for (int i = 0; i < count; ++i) children.push_back(new Object(&parent));
    std::shuffle(children.begin(), children.end(), std::mt19937(1));
    const std::int64_t began = sheet::now_ns();
    for (Object* child : children) delete child;
    const std::string name = "objects/bury-order/random/" + std::to_string(count);
    sheet::figure(name, "bury_ns", "ns", static_cast<double>(sheet::now_ns() - began) / count);
}

}  // namespace

int main(int count, char** words) {
    QCoreApplication app(count, words);
    const bool smoke = sheet::is_smoke(count, words);
    const std::string part = count > 2 ? words[2] : "";
    if (part == "flat") flat(smoke ? 10 : 1'000'000, false);
    if (part == "connected") flat(smoke ? 10 : 1'000'000, true);
    if (part == "chain") chain_on_a_large_stack(smoke ? 10 : 100'000);
    // A child that goes is looked for among its siblings: a million would take hours.
    if (part == "order") random_order(smoke ? 10 : 10'000);
    return 0;
}
