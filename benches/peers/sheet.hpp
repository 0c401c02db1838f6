// What every C++ peer shares: the lines in which it tells what it measured, and the clock.
//
//   figure  CASE  METRIC  UNIT  VALUE
//   sample  CASE  METRIC  NS    COUNT
#pragma once

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
