// threads STREAM: decodes streams of their own on two threads, and one stream on both, and compares all means.
#include <thread>

#include "stream.hpp"

int main(int count, char **arguments) try {
    if (count != 2) return 2;
    const Bytes bytes = read(arguments[1]);
    const Stream shared = open(bytes);
    const auto means = array(shared.get(), GSVX_ARRAY_MEANS);
    bool ok[2] = {false, false};
    auto work = [&](int number) {
        ok[number] = same(array(open(bytes).get(), GSVX_ARRAY_MEANS), means);
        // What another thread decodes meanwhile is another chunk: any status but a mistake.
        for (std::uint64_t i = 0; i < 20; i++) {
            float out[3000];
            std::uint64_t gaussians;
            gsvx_status status = gsvx_decode(shared.get(), i % 5, 1, &gaussians, nullptr);
            if (status == GSVX_STATUS_OK) status = gsvx_copy(shared.get(), GSVX_ARRAY_MEANS, out, sizeof out, nullptr);
            ok[number] = ok[number] && (status == GSVX_STATUS_OK || status == GSVX_STATUS_BUFFER);
        }
    };
    std::thread one(work, 0), two(work, 1);
    one.join();
    two.join();
    if (!ok[0] || !ok[1]) throw std::runtime_error("threads differ");
    return 0;
} catch (const std::exception &error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
