"""The planted tournament of docs/paper_protocol.png: equal defenders, weaker attackers."""

from benchmarks import paper_protocol


def test_the_papers_protocol_sees_a_difference_that_the_defenders_do_not_have(monkeypatch):
    monkeypatch.setattr(paper_protocol, "CHUNKS", 10)
    result = paper_protocol.planted(weaker=300, seeds=3, seed=0)
    protocol = paper_protocol.examine(result, every=2)
    assert protocol is not None and protocol.difference > 70
    told = paper_protocol.summary(protocol)
    assert f"{protocol.difference:+.0f} points" in told and "200 points weaker" in told
