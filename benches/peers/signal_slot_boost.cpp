// boost::signals2: direct calls, connecting and disconnecting.
#include "direct.hpp"

#include <boost/signals2.hpp>

struct Boost {
    using Numbers = boost::signals2::signal<void(std::int64_t)>;
    using Texts = boost::signals2::signal<void(const std::string&)>;
    using Connection = boost::signals2::connection;

    template <typename Signal, typename Slot>
    static Connection connect(Signal& signal, Slot slot) {
        return signal.connect(slot);
    }
};

int main(int count, char** words) { return direct::measure<Boost>(count, words); }
