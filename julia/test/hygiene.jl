using Aqua
Aqua.test_all(PomdpHarness; ambiguities = false, persistent_tasks = false)

@testset "every export is documented" begin
    documented = keys(Base.Docs.meta(PomdpHarness))
    names_with_docs = Set(String(b.var) for b in documented)
    undocumented = [n for n in names(PomdpHarness) if n != :PomdpHarness && !(String(n) in names_with_docs)]
    @test isempty(undocumented)
end
