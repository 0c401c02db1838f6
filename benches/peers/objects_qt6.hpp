// The object of the peer on Qt 6; a header because Qt's meta-object compiler reads headers.
#pragma once

#include <QObject>

class Object : public QObject {
    Q_OBJECT
public:
    explicit Object(QObject* parent = nullptr) : QObject(parent) { ++count(); }
    ~Object() override { --count(); }
    static long living() { return count(); }
    void take(qint64 number) { sum += number; }

Q_SIGNALS:
    void number(qint64 number);

private:
    static long& count() {
        static long living = 0;
        return living;
    }
    qint64 sum = 0;
};
