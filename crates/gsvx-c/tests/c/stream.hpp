// What the C++ programs of the tests share.
#pragma once

#include <cstdio>
#include <cstring>
#include <fstream>
#include <iterator>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "gsvx.h"

struct Close {
    void operator()(gsvx_stream *stream) const { gsvx_close(stream); }
};
using Stream = std::unique_ptr<gsvx_stream, Close>;
using Bytes = std::vector<std::uint8_t>;

inline void check(gsvx_status status, const gsvx_message &why) {
    if (status != GSVX_STATUS_OK) throw std::runtime_error(why.text);
}

inline Stream open(const Bytes &bytes) {
    gsvx_message why;
    gsvx_stream *stream = nullptr;
    check(gsvx_open(nullptr, &stream, &why), why);
    Stream owner(stream);
    check(gsvx_give(stream, 0, bytes.data(), bytes.size(), &why), why);
    return owner;
}

inline std::vector<float> array(gsvx_stream *stream, gsvx_array which) {
    gsvx_message why;
    gsvx_info info;
    check(gsvx_get_info(stream, &info, &why), why);
    std::vector<float> all;
    for (std::uint64_t chunk = 0; chunk < info.chunks; chunk++) {
        std::uint64_t count = 0;
        check(gsvx_decode(stream, chunk, 4, &count, &why), why);
        std::vector<float> part(count * gsvx_stride(which, info.sh_degree) / sizeof(float));
        check(gsvx_copy(stream, which, part.data(), part.size() * sizeof(float), &why), why);
        all.insert(all.end(), part.begin(), part.end());
    }
    return all;
}

inline bool same(const std::vector<float> &a, const std::vector<float> &b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

inline Bytes read(const char *path) {
    std::ifstream file(path, std::ios::binary);
    return Bytes(std::istreambuf_iterator<char>(file), {});
}
