// libsigc++: direct calls, connecting and disconnecting.
#include "direct.hpp"

#include <sigc++/sigc++.h>

struct Sigc {
    using Numbers = sigc::signal<void, std::int64_t>;
    using Texts = sigc::signal<void, const std::string&>;
    using Connection = sigc::connection;

    template <typename Signal, typename Slot>
    static Connection connect(Signal& signal, Slot slot) {
        return signal.connect(slot);
    }
};

int main(int count, char** words) { return direct::measure<Sigc>(count, words); }
