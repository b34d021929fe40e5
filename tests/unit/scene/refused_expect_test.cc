#include "tests/unit/scene/scenes.h"

namespace twoport::test {

INSTANTIATE_TEST_SUITE_P(
    Expect, RefusedScene,
    ::testing::Values(
        Refusal{kStiffWall,
                {"expect.at_least[0].key=min_port_energy"},
                "expect.at_least[0].key is \"min_port_energy\"; it must be a number of the summary; the "
                "nearest are min_port_energy_j, "},
        Refusal{kStiffWall,
                {"expect.at_most[0].key=stable"},
                "expect.at_most[0].key is \"stable\"; it must be a number of the summary; `expect { "
                "stable: ... }` is for that one"},
        Refusal{kStiffWall,
                {"expect.at_most[0].key=verdict"},
                "expect.at_most[0].key is \"verdict\"; it must be a number of the summary; the nearest are "},
        Refusal{kStiffWall,
                {"expect.at_most[0]={key: \"steps\"}"},
                "expect.at_most[0].value is missing; it must be a finite number"},
        Refusal{
            kStiffWall, {"expect.at_most[0].value=nan"}, "expect.at_most[0].value is nan; it must be a finite number"}),
    name_of);

}  // namespace twoport::test
