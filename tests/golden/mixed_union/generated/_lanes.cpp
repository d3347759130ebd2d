// runtime/core/sink.h stands here

// backend/cpp/preludes/kernel.h stands here

// backend/cpp/preludes/scatter.h stands here

// backend/cpp/preludes/lanes.h stands here

// backend/cpp/preludes/add_lanes.h stands here

extern "C" void yasps<_lanes>_gradient(const yasps_sink& sink, const LaneSlot* slots, long count, const int* kappa, long capacity, unsigned lanes, const V* gradient, const LaneRoom& room) { add_gradient_of_lanes(sink, slots, count, kappa, capacity, lanes, gradient, room); }

extern "C" void yasps<_lanes>_hessian(const yasps_sink& sink, LaneSlot* slots, long count, const long* position, long capacity, unsigned lanes, const V* h, long n, const LaneRoom& room) { add_hessian_of_lanes(sink, slots, count, position, capacity, lanes, h, n, room); }
