// encode STREAM: encodes what a stream decodes to, for a number of bytes, and what no stream can be made of.
#include <limits>

#include "stream.hpp"

// A stream of the decoded Gaussians, at most as large as asked for.
void encode(gsvx_stream *stream, std::uint64_t max_bytes) {
    auto means = array(stream, GSVX_ARRAY_MEANS), rotations = array(stream, GSVX_ARRAY_ROTATIONS);
    auto log_scales = array(stream, GSVX_ARRAY_LOG_SCALES), logits = array(stream, GSVX_ARRAY_OPACITY_LOGITS);
    auto sh = array(stream, GSVX_ARRAY_SH);
    gsvx_info info;
    gsvx_message why;
    check(gsvx_get_info(stream, &info, &why), why);
    gsvx_model model{means.size() / 3, means.data(), rotations.data(), log_scales.data(),
                     logits.data(),    sh.data(),    info.sh_degree,   GSVX_AXES_UNITY, info.antialiased};
    gsvx_encode_options options{max_bytes, 0};
    std::uint8_t *bytes = nullptr;
    std::size_t size = 0;
    check(gsvx_encode(&model, &options, &bytes, &size, &why), why);
    Bytes made(bytes, bytes + size);
    gsvx_free(bytes, size);
    if (size > max_bytes || array(open(made).get(), GSVX_ARRAY_MEANS).empty()) throw std::runtime_error("the size");
    options = {0, 101};
    if (gsvx_encode(&model, &options, &bytes, &size, &why) != GSVX_STATUS_ARGUMENT || bytes != nullptr)
        throw std::runtime_error("a quality of 101 is accepted");
    options = {1, 0};
    if (gsvx_encode(&model, &options, &bytes, &size, &why) != GSVX_STATUS_ARGUMENT)
        throw std::runtime_error("a stream of one byte is promised");
    means[4] = std::numeric_limits<float>::infinity();
    if (gsvx_encode(&model, nullptr, &bytes, &size, &why) != GSVX_STATUS_MODEL)
        throw std::runtime_error("an infinite mean is accepted");
    model.means = nullptr;
    if (gsvx_encode(&model, nullptr, &bytes, &size, &why) != GSVX_STATUS_ARGUMENT)
        throw std::runtime_error("null is accepted");
    gsvx_free(nullptr, 0);
}

int main(int count, char **arguments) try {
    if (count != 2) return 2;
    encode(open(read(arguments[1])).get(), 6000);
    return 0;
} catch (const std::exception &error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
