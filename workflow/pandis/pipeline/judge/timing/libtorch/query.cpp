// Loads a compiled network and times it one query at a time, as a device's loop would ask it.
//
// Usage: query PACKAGE POINTS ANSWERS QUERIES
// POINTS: float64 (n, 3), raw. ANSWERS: n times distance, normal (float64 x 4), then the
// nanoseconds of QUERIES single queries (float64), taken from the points in order, over and over.
#include <chrono>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <iterator>
#include <vector>

#include <ATen/Parallel.h>
#include <torch/csrc/inductor/aoti_package/model_package_loader.h>
#include <torch/torch.h>

int main(int count, char **arguments) {
    if (count != 5) {
        std::cerr << "usage: query PACKAGE POINTS ANSWERS QUERIES\n";
        return 2;
    }
    c10::InferenceMode guard;
    at::set_num_threads(1);
    torch::inductor::AOTIModelPackageLoader network(arguments[1], "model", true);

    std::ifstream file(arguments[2], std::ios::binary);
    std::vector<char> bytes((std::istreambuf_iterator<char>(file)), {});
    const int64_t size = bytes.size() / (3 * sizeof(double));
    auto points = torch::from_blob(bytes.data(), {size, 3}, torch::kFloat64).clone();

    std::vector<double> out;
    for (int64_t i = 0; i < size; ++i) {
        auto answer = network.run({points.slice(0, i, i + 1)});
        out.push_back(answer[0].item<float>());
        for (int k = 0; k < 3; ++k) out.push_back(answer[1][0][k].item<float>());
    }
    using clock = std::chrono::steady_clock;
    const int64_t queries = std::atoll(arguments[4]);
    for (int64_t i = 0; i < queries; ++i) {
        const auto start = clock::now();
        std::vector<at::Tensor> point{points.slice(0, i % size, i % size + 1)};
        auto answer = network.run(point);
        const std::chrono::duration<double, std::nano> taken = clock::now() - start;
        out.push_back(taken.count());
    }
    std::ofstream(arguments[3], std::ios::binary)
        .write(reinterpret_cast<const char *>(out.data()), out.size() * sizeof(double));
    return 0;
}
