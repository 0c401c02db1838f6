// What every C++ peer shares: the lines in which it tells what it measured, and the clock.
//
//   figure  CASE  METRIC  UNIT  VALUE
//   sample  CASE  METRIC  NS    COUNT
#pragma once

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <string>

namespace sheet {

inline void figure(const std::string& name, const char* metric, const char* unit, double value) {
    std::printf("figure\t%s\t%s\t%s\t%.6f\n", name.c_str(), metric, unit, value);
}

inline void sample(const std::string& name, const char* metric, std::uint64_t ns) {
    std::printf("sample\t%s\t%s\t%llu\t1\n", name.c_str(), metric, static_cast<unsigned long long>(ns));
}

inline std::int64_t now_ns() {
    using namespace std::chrono;
    return duration_cast<nanoseconds>(steady_clock::now().time_since_epoch()).count();
}

// The first argument says how much work is to be done.
inline bool is_smoke(int count, char** words) { return count > 1 && std::strcmp(words[1], "smoke") == 0; }

// Keeps the compiler from knowing the value.
template <typename T>
inline void opaque(T& value) {
    asm volatile("" : "+m"(value) : : "memory");
}

// Runs `work` on slices of `units / 11` each, after one that does not count, and answers the median of the
// nanoseconds per unit: the same measure as on our side.
template <typename Work>
double ns_per_unit(std::int64_t units, Work work) {
    constexpr std::size_t slices = 11;
    const std::int64_t slice = std::max<std::int64_t>(units / static_cast<std::int64_t>(slices), 1);
    std::array<double, slices> spans{};
    work(slice);
    for (double& span : spans) {
        const std::int64_t began = now_ns();
        work(slice);
        span = static_cast<double>(now_ns() - began) / static_cast<double>(slice);
    }
    std::sort(spans.begin(), spans.end());
    return spans[slices / 2];
}

// The name of a case of direct calls.
inline std::string direct_case(int slots, const char* end) {
    return slots == 0 ? std::string("direct/none") + end : "direct/" + std::to_string(slots) + end;
}

// The memory of the process that lies in RAM, in bytes.
inline double resident_bytes() {
    long pages = 0, ignored = 0;
    if (FILE* file = std::fopen("/proc/self/statm", "r")) {
        if (std::fscanf(file, "%ld %ld", &ignored, &pages) != 2) pages = 0;
        std::fclose(file);
    }
    return static_cast<double>(pages) * 4096.0;
}

}  // namespace sheet
