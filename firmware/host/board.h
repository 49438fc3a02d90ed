// SPDX-License-Identifier: Apache-2.0
// What boards on a computer have in common: a memory, and bytes of the line that wait to be read.
#pragma once

#include "../node/port.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <vector>

namespace sinew {

class Memory : public Store {
public:
    bool load(uint8_t* bytes, size_t size) override {
        if (kept_.size() != size) return false;
        std::copy(kept_.begin(), kept_.end(), bytes);
        return true;
    }
    void save(const uint8_t* bytes, size_t size) override { kept_.assign(bytes, bytes + size); }

private:
    std::vector<uint8_t> kept_;
};

class Inbox : public Wire {
public:
    std::deque<uint8_t> inbox;

    int read() override {
        if (inbox.empty()) return -1;
        const int byte = inbox.front();
        inbox.pop_front();
        return byte;
    }
};

}  // namespace sinew
